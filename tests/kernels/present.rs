//! Kernel `present` against its twin: every kind of picture, equal and other sizes, both byte orders.

use instgs_vk::gpu::Recorder;
use instgs_vk::reference::present as twin;
use instgs_vk::render::{Presenter, RenderOptions, Renderer, Show, Surfaces};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::random_scene::random_case;

/// How far beyond a rounding border a level may be from what the twin says; measured on lavapipe: 0.
const TOLERANCE: f64 = 1e-3;

#[test]
fn windows_show_what_the_twin_says() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let mut presenter = Presenter::new(&gpu, &renderer).unwrap();
    let mut surfaces = Surfaces::new(&gpu).unwrap();
    let mut recorder = Recorder::new(&gpu).unwrap();
    let case = random_case(4);
    let device = renderer.upload(&case.scene).unwrap();
    // Every other instance, so that there are lines between neighbours.
    let chosen: Vec<bool> = (0..case.scene.instances.len()).map(|k| k % 2 == 0).collect();
    presenter.set_chosen(&chosen).unwrap();
    let mut worst = 0.0f64;
    for size in [(37, 21), (64, 48), (1, 1)] {
        let camera = case.camera.resized(size.0, size.1);
        renderer.render_with_surfaces(&device, &camera, &RenderOptions::default(), &mut surfaces).unwrap();
        let picture = renderer.download().unwrap();
        let by_pixel = surfaces.download().unwrap();
        let far = picture.depths.iter().copied().fold(1.0, f32::max);
        for (show, twin_show) in [
            (Show::Color, twin::Show::Color),
            (Show::Alpha, twin::Show::Alpha),
            (Show::Instances, twin::Show::Instances),
            (Show::Depth([0.25, far]), twin::Show::Depth([0.25, f64::from(far)])),
        ] {
            let want = twin::Shown {
                size_px: [size.0 as usize, size.1 as usize],
                colors: &picture.colors,
                depths: &picture.depths,
                show: twin_show,
                surfaces: &by_pixel,
                chosen: &chosen,
            };
            for shown_px in [[size.0, size.1], [91, 40], [8, 5], [1, 3]] {
                for blue_first in [false, true] {
                    let shown = (show, Some(&surfaces));
                    presenter.record(&mut recorder, &renderer, shown, (shown_px, blue_first)).unwrap();
                    let ticket = recorder.submit().unwrap();
                    recorder.wait(ticket).unwrap();
                    let mut got = presenter.rgb8().unwrap();
                    if blue_first {
                        got.chunks_exact_mut(3).for_each(|rgb| rgb.swap(0, 2));
                    }
                    let levels = want.levels(shown_px.map(|side| side as usize));
                    assert_eq!(got.len(), 3 * levels.len());
                    for (got, want) in got.iter().zip(levels.as_flattened()) {
                        // How far the level would have to be from what the twin says to be rounded to this byte.
                        let error = ((f64::from(*got) - want).abs() - 0.5).max(0.0);
                        worst = worst.max(error);
                        assert!(error < TOLERANCE, "{show:?} {size:?} in {shown_px:?}: {got} for {want}");
                    }
                }
            }
        }
    }
    println!("levels within {worst:.1e} of the twin's");
    assert_silent(&gpu);
}

/// A window whose scene is still on its way is black.
#[test]
fn without_a_picture_the_window_is_black() {
    let Some(gpu) = gpu() else { return };
    let renderer = Renderer::new(&gpu).unwrap();
    let mut presenter = Presenter::new(&gpu, &renderer).unwrap();
    let mut recorder = Recorder::new(&gpu).unwrap();
    presenter.record(&mut recorder, &renderer, (Show::Color, None), ([5, 3], true)).unwrap();
    let ticket = recorder.submit().unwrap();
    recorder.wait(ticket).unwrap();
    assert_eq!(presenter.rgb8().unwrap(), [0; 45]);
    assert_silent(&gpu);
}
