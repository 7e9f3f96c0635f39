//! Levels of detail: pictures against the twin, full quality untouched, nothing pops, edits and picking see instances.

use glam::DVec3;

use instgs_reference::{View, lod, render_sources};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{DeviceScene, Picture, RenderOptions, Renderer, Surfaces};
use instgs_vk::scene::edit::{Edit, apply};
use instgs_vk::scene::lod::Levels;
use instgs_vk::scene::{Camera, Gaussians, Instance, InstancedScene, SourceRange};

use crate::common::gpu::{alpha, assert_silent, device_options, gpu, rgb};
use crate::common::random_scene::{random_case, rare_case};
use crate::common::{ImageComparison, both_robust, single_channel};

/// Pixels that cells may be wide: from hardly anything merged to everything.
const ERRORS_PX: [f32; 3] = [6.0, 25.0, 100.0];

fn with_error(options: RenderOptions, lod_error_px: f32) -> RenderOptions {
    RenderOptions { lod_error_px, ..options }
}

fn picture(renderer: &mut Renderer, scene: &DeviceScene, camera: &Camera, options: &RenderOptions) -> Picture {
    renderer.render(scene, camera, options).unwrap();
    renderer.download().unwrap()
}

/// A faint splat of a fading level may be on either side of the smallest alpha that is blended, since its weight is a
/// logarithm in f32: as much of a pixel may differ ...
const ONE_FAINT_SPLAT: f64 = 1.05 / 255.0;
/// ... in so many pixels.
const MOST_FAINT: f64 = 0.005;

fn is_close(got: &[f64; 3], want: &[f64; 3]) -> bool {
    got.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-4)
}

/// Random scenes, those with all kinds of offsets too: colour and alpha within 1e-4 of the twin where it is robust, but for
/// faint splats; and the same bytes as without levels where the error is 0.
#[test]
fn pictures_are_the_twins_and_an_error_of_0_is_full_quality() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let (mut worst, mut faded, mut changed, mut faint, mut pixels) = (0.0f64, 0, 0, 0, 0);
    for case in (0..40).map(random_case).chain((0..20).map(rare_case)) {
        let options = device_options(&case.options);
        let plain = renderer.upload(&case.scene).unwrap();
        let scene = renderer.upload_for(&case.scene, &with_error(options, 1.0)).unwrap();
        let full = picture(&mut renderer, &plain, &case.camera, &options);
        assert!(picture(&mut renderer, &scene, &case.camera, &options) == full, "seed {}", case.seed);
        let levels = Levels::of(&case.scene);
        let view = View::device(&case.camera, &case.options);
        for error_px in ERRORS_PX {
            let got = picture(&mut renderer, &scene, &case.camera, &with_error(options, error_px));
            let twin = render_sources(&lod::sources(&levels, &view, error_px.into()), &view);
            let weights = levels.parts.iter().map(|part| lod::level_weight(&levels, part, &view, error_px.into()));
            faded += weights.filter(|&w| w > 0.0 && w < 1.0).count();
            changed += usize::from(got != full);
            let close: Vec<bool> = (0..twin.color.len()).map(|i| is_close(&rgb(&got)[i], &twin.color[i])).collect();
            let robust = both_robust(&twin.robust, &close);
            faint += twin.robust.iter().zip(&close).filter(|&(&robust, &close)| robust && !close).count();
            pixels += close.len();
            for (tolerance, robust) in [(1e-4, &robust), (ONE_FAINT_SPLAT, &twin.robust)] {
                for comparison in [
                    ImageComparison::new(&rgb(&got), &twin.color, robust),
                    ImageComparison::new(&alpha(&got), &single_channel(&twin.alpha), robust),
                ] {
                    worst = worst.max(comparison.max_abs_error);
                    assert!(comparison.non_finite == 0, "seed {}, {error_px} px", case.seed);
                    let error = comparison.max_abs_error;
                    assert!(error < tolerance, "seed {}, {error_px} px: {error:.2e}", case.seed);
                }
            }
        }
    }
    println!(
        "worst {worst:.2e}; {faint} faint of {pixels} pixels; {faded} fading parts, {changed} of 180 pictures changed"
    );
    assert!(faint as f64 <= MOST_FAINT * pixels as f64, "{faint} of {pixels}");
    assert!(faded > 20 && changed > 90, "{faded} {changed}");
    assert_silent(&gpu);
}

/// Balls of 2,000 small Gaussians with colours that vary smoothly, in a row away from the camera, over a background.
fn row_of_balls() -> InstancedScene {
    let mut rng = Rng::new(7);
    let mut ball = |count: usize, radius: f64, log_scale: f32| {
        let mut cloud = Gaussians::with_capacity(0, count);
        for _ in 0..count {
            let at = rng.unit_vector();
            cloud.means.push((radius * at).as_vec3().to_array());
            cloud.quats.push(rng.rotation_quat().map(|q| q as f32));
            cloud.log_scales.push([log_scale; 3]);
            cloud.opacity_logits.push(2.0);
            cloud.sh.push((2.0 * at).as_vec3().to_array());
        }
        cloud
    };
    let place = |k: u32| Similarity::from_parts(glam::DMat3::IDENTITY, 1.0, DVec3::new(0.0, 0.0, 3.0 * f64::from(k)));
    InstancedScene {
        templates: ball(2000, 1.0, -3.2),
        template_ranges: vec![SourceRange { first: 0, count: 2000 }],
        instances: (0..4)
            .map(|k| Instance { template: 0, world_from_template: place(k), first_offset: None })
            .collect(),
        background: ball(6000, 80.0, 0.5),
        ..InstancedScene::default()
    }
}

fn camera_at(distance: f64) -> Camera {
    let eye = DVec3::new(0.3 * distance, -0.4 * distance, -distance);
    Camera::look_at("flight", eye, DVec3::new(0.0, 0.0, 3.0), DVec3::NEG_Y, 0.7, (96, 64))
}

/// Larger errors draw less, and never more than everything.
#[test]
fn coarser_is_less() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    // A background of four blocks around the camera is always near.
    let balls = InstancedScene { background: Gaussians::default(), ..row_of_balls() };
    let scene = renderer.upload_for(&balls, &with_error(RenderOptions::default(), 1.0)).unwrap();
    let mut visible = Vec::new();
    for error_px in [0.0, 1.0, 4.0, 16.0, 64.0] {
        let stats = renderer.render(&scene, &camera_at(12.0), &with_error(RenderOptions::default(), error_px)).unwrap();
        visible.push(stats.visible);
    }
    println!("visible: {visible:?}");
    assert!(visible.windows(2).all(|v| v[1] <= v[0]) && visible[4] * 20 < visible[0], "{visible:?}");
    assert_silent(&gpu);
}

/// Root mean square over all colours.
fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

fn difference(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

/// Levels fade into one another: along a flight in steps of 1 % what an error of 4 px changes of the picture never changes
/// by more than a part of what lies between two levels, which is by how much it would pop.
#[test]
fn nothing_pops() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = renderer.upload_for(&row_of_balls(), &with_error(RenderOptions::default(), 1.0)).unwrap();
    let mut colors = |camera: &Camera, error_px: f32| -> Vec<f64> {
        let picture = picture(&mut renderer, &scene, camera, &with_error(RenderOptions::default(), error_px));
        picture.colors.iter().flat_map(|c| [c[0], c[1], c[2]].map(f64::from)).collect()
    };
    let mut before: Option<Vec<f64>> = None;
    let (mut step, mut pop) = (0.0f64, 0.0f64);
    for k in 0..100 {
        let camera = camera_at(40.0 * 0.99f64.powi(k));
        let [full, coarse, finer] = [0.0, 4.0, 2.0].map(|error_px| colors(&camera, error_px));
        pop = pop.max(rms(&difference(&coarse, &finer)));
        let changed = difference(&coarse, &full);
        if let Some(before) = before {
            step = step.max(rms(&difference(&changed, &before)));
        }
        before = Some(changed);
    }
    println!("largest step {step:.2e}, between levels {pop:.2e}, rms");
    assert!(pop > 1e-3 && step < 0.35 * pop, "{step} {pop}");
    assert_silent(&gpu);
}

/// An instance that is moved takes its levels along, and picking says whose level it is.
#[test]
fn levels_move_with_their_instance_and_are_picked_as_it() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let mut scene = row_of_balls();
    let options = with_error(RenderOptions::default(), 4.0);
    let mut moved = renderer.upload_for(&scene, &options).unwrap();
    let place = Similarity::from_parts(glam::DMat3::from_rotation_y(0.5), 1.5, DVec3::new(-2.0, 0.5, 1.0));
    moved.place_instances(&[(2, place)]).unwrap();
    scene.instances[2].world_from_template = place;
    let uploaded = renderer.upload_for(&scene, &options).unwrap();
    let mut surfaces = Surfaces::new(&gpu).unwrap();
    let mut owners = std::collections::BTreeSet::new();
    for distance in [40.0, 15.0, 6.0] {
        let camera = camera_at(distance);
        let got = picture(&mut renderer, &moved, &camera, &options);
        assert!(got == picture(&mut renderer, &uploaded, &camera, &options), "at {distance}");
        renderer.render_with_surfaces(&moved, &camera, &options, &mut surfaces).unwrap();
        owners.extend(surfaces.download().unwrap().into_iter().flatten().map(|point| point.instance));
    }
    assert!(owners.iter().all(|&k| k <= 4) && owners.contains(&2) && owners.contains(&4), "{owners:?}");
    assert_silent(&gpu);
}

/// Own Gaussians are drawn, moved, hidden and picked with their instance, at full detail and beside its levels.
#[test]
fn own_gaussians_follow_their_instance() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let mut scene = row_of_balls();
    // A cap above each ball, of its own size, for instances 1 and 2.
    scene.own = scene.templates.filtered(|i| i < 200);
    scene.own.means.iter_mut().for_each(|mean| mean[1] -= 1.5);
    let range = |first, count| SourceRange { first, count };
    scene.own_ranges = vec![range(0, 0); scene.instances.len()];
    (scene.own_ranges[1], scene.own_ranges[2]) = (range(0, 150), range(150, 50));
    scene.validate().unwrap();
    let bare = InstancedScene { own: Default::default(), own_ranges: Vec::new(), ..scene.clone() };
    let template_of_2 = scene.template_ranges[scene.instances[2].template as usize].count;
    for error_px in [0.0, 4.0] {
        let options = with_error(RenderOptions::default(), error_px);
        let camera = camera_at(15.0);
        let mut device = renderer.upload_for(&scene, &options).unwrap();
        let mut surfaces = Surfaces::new(&gpu).unwrap();
        renderer.render_with_surfaces(&device, &camera, &options, &mut surfaces).unwrap();
        let points: Vec<_> = surfaces.download().unwrap().into_iter().flatten().collect();
        assert!(points.iter().any(|point| point.instance == 2 && point.local >= template_of_2), "{error_px}");
        let without = renderer.upload_for(&bare, &options).unwrap();
        let before = picture(&mut renderer, &device, &camera, &options);
        assert!(before != picture(&mut renderer, &without, &camera, &options), "they show");
        let place = Similarity::from_parts(glam::DMat3::from_rotation_y(0.5), 1.5, DVec3::new(-2.0, 0.5, 1.0));
        device.place_instances(&[(2, place)]).unwrap();
        let mut moved = scene.clone();
        moved.instances[2].world_from_template = place;
        let uploaded = renderer.upload_for(&moved, &options).unwrap();
        let got = picture(&mut renderer, &device, &camera, &options);
        assert!(got == picture(&mut renderer, &uploaded, &camera, &options), "moved, {error_px}");
        device.show_instances(&[(1, false)]).unwrap();
        apply(&mut moved, &Edit::Delete { which: "1".parse().unwrap() }).unwrap();
        assert_eq!(moved.own.len(), 50);
        let uploaded = renderer.upload_for(&moved, &options).unwrap();
        let got = picture(&mut renderer, &device, &camera, &options);
        assert!(got == picture(&mut renderer, &uploaded, &camera, &options), "hidden, {error_px}");
    }
    assert_silent(&gpu);
}

#[test]
fn levels_that_are_not_there_or_make_no_sense_are_errors() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = renderer.upload(&row_of_balls()).unwrap();
    for (error_px, words) in [(2.0, "without levels of detail"), (f32::NAN, "finite"), (-1.0, "finite")] {
        let options = with_error(RenderOptions::default(), error_px);
        let error = renderer.render(&scene, &camera_at(9.0), &options).unwrap_err().to_string();
        assert!(error.contains("lod") && error.contains(words), "{error}");
    }
    assert_silent(&gpu);
}
