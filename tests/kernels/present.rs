//! Kernel `present` against its twin: every kind of picture, equal and other sizes, both byte orders, in one piece and in
//! depth slabs.

use std::sync::Arc;

use instgs_reference::present as twin;
use instgs_reference::tile_surface as twin_surface;
use instgs_vk::gpu::staging::download;
use instgs_vk::gpu::{Gpu, Recorder};
use instgs_vk::math::rng::Rng;
use instgs_vk::render::{
    DeviceScene, InstanceLook, MarkShape, Marks, Picture, Presenter, RenderOptions, Renderer, Show, ShownPicture,
    SurfacePoint, Surfaces,
};
use instgs_vk::scene::{Camera, InstancedScene};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::random_scene::{RandomCase, add_own_gaussians, random_case};

/// How far beyond a rounding border a level may be from what the twin says; measured on lavapipe: 0.
const TOLERANCE: f64 = 1e-3;

/// What draws and shows one scene.
struct Bench {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    presenter: Presenter,
    surfaces: Surfaces,
    marks: Marks,
    recorder: Recorder,
}

impl Bench {
    fn new(gpu: &Arc<Gpu>) -> Self {
        let renderer = Renderer::new(gpu).unwrap();
        Self {
            gpu: gpu.clone(),
            presenter: Presenter::new(gpu, &renderer).unwrap(),
            surfaces: Surfaces::new(gpu).unwrap(),
            marks: Marks::new(gpu).unwrap(),
            recorder: Recorder::new(gpu).unwrap(),
            renderer,
        }
    }

    /// Draws a picture with all that views need; the depth slabs it took.
    fn draw(&mut self, scene: &DeviceScene, camera: &Camera, options: &RenderOptions) -> u32 {
        let (marks, shape, surfaces) = (&mut self.marks, MarkShape::Ellipses(0.1), Some(&mut self.surfaces));
        self.renderer.render_with_marks(scene, camera, options, marks, shape, surfaces).unwrap().slabs
    }

    /// Bytes red, green, blue of a window, whatever their order in it; `known` = with all that views need.
    fn pixels(
        &mut self,
        scene: &DeviceScene,
        (show, known): (Show, bool),
        (shown_px, blue_first): ([u32; 2], bool),
    ) -> Vec<u8> {
        let picture = ShownPicture {
            renderer: &self.renderer,
            scene,
            surfaces: known.then_some(&self.surfaces),
            marks: known.then_some(&self.marks),
        };
        self.presenter.record(&mut self.recorder, show, picture, shown_px, blue_first).unwrap();
        let ticket = self.recorder.submit().unwrap();
        self.recorder.wait(ticket).unwrap();
        let mut pixels = self.presenter.rgb8().unwrap();
        if blue_first {
            pixels.chunks_exact_mut(3).for_each(|rgb| rgb.swap(0, 2));
        }
        pixels
    }

    fn read(&self) -> Inputs {
        let frame = self.renderer.frame().unwrap();
        let ranges = download(&self.gpu, &frame.tile_ranges, frame.plan.tile_count() as usize).unwrap();
        let point = |p: SurfacePoint| twin_surface::SurfacePoint { instance: p.instance, local: p.local };
        Inputs {
            picture: self.renderer.download().unwrap(),
            surfaces: self.surfaces.download().unwrap().into_iter().map(|s| s.map(point)).collect(),
            tile_size: frame.plan.size_px[0].div_ceil(frame.plan.tiles[0]).next_multiple_of(8) as usize,
            marks: self.marks.download().unwrap(),
            tile_loads: ranges.iter().map(|[begin, end]| end - begin).collect(),
        }
    }
}

/// What `present` reads, for the twin.
struct Inputs {
    picture: Picture,
    surfaces: Vec<Option<twin_surface::SurfacePoint>>,
    tile_size: usize,
    tile_loads: Vec<u32>,
    marks: Vec<Option<[u8; 3]>>,
}

impl Inputs {
    fn shown<'a>(&'a self, scene: &'a InstancedScene, chosen: &'a [bool], show: twin::Show) -> twin::Shown<'a> {
        twin::Shown {
            size_px: [self.picture.width as usize, self.picture.height as usize],
            colors: &self.picture.colors,
            depths: &self.picture.depths,
            show,
            surfaces: &self.surfaces,
            chosen,
            scene: Some(scene),
            tile_loads: (self.tile_size, &self.tile_loads),
            marks: &self.marks,
        }
    }
}

/// All views, with values that make some of each picture's pixels differ.
fn views(far: f32) -> Vec<(Show, twin::Show)> {
    vec![
        (Show::Color, twin::Show::Color),
        (Show::Alpha, twin::Show::Alpha),
        (Show::Depth([0.25, far]), twin::Show::Depth([0.25, f64::from(far)])),
        (Show::Instances, twin::Show::Instances),
        (Show::Templates, twin::Show::Templates),
        (Show::TileLoad(100.0), twin::Show::TileLoad(100.0)),
        (Show::Offsets(0.125), twin::Show::Offsets(0.125)),
        (Show::Ellipses(0.1), twin::Show::Marks),
    ]
}

fn looks(scene: &InstancedScene, chosen: &[bool]) -> Vec<InstanceLook> {
    let look =
        |(instance, &chosen): (&instgs_vk::scene::Instance, _)| InstanceLook { chosen, template: instance.template };
    scene.instances.iter().zip(chosen).map(look).collect()
}

/// How far the worst level would have to be from what the twin says to be rounded to its byte.
fn error(got: &[u8], want: &[[f64; 3]]) -> f64 {
    assert_eq!(got.len(), 3 * want.len());
    let beyond = |(got, want): (&u8, &f64)| ((f64::from(*got) - want).abs() - 0.5).max(0.0);
    got.iter().zip(want.as_flattened()).map(beyond).fold(0.0, f64::max)
}

/// The largest error of a level in all views of a case, with and without selected instances, in several windows.
fn worst_level(bench: &mut Bench, case: &RandomCase) -> f64 {
    let device = bench.renderer.upload(&case.scene).unwrap();
    let nobody = vec![false; case.scene.instances.len()];
    // Every other instance, so that there are lines between neighbours.
    let some: Vec<bool> = (0..nobody.len()).map(|k| k % 2 == 0).collect();
    let mut worst = 0.0f64;
    for (size, chosen) in [((37, 21), &some), ((64, 48), &some), ((64, 48), &nobody), ((1, 1), &some)] {
        bench.presenter.set_instances(&looks(&case.scene, chosen)).unwrap();
        bench.draw(&device, &case.camera.resized(size.0, size.1), &RenderOptions::default());
        let inputs = bench.read();
        let far = inputs.picture.depths.iter().copied().fold(1.0, f32::max);
        for (show, twin_show) in views(far) {
            let want = inputs.shown(&case.scene, chosen, twin_show);
            for shown_px in [[size.0, size.1], [91, 40], [8, 5], [1, 3]] {
                let levels = want.levels(shown_px.map(|side| side as usize));
                for blue_first in [false, true] {
                    let got = bench.pixels(&device, (show, true), (shown_px, blue_first));
                    let error = error(&got, &levels);
                    assert!(error < TOLERANCE, "{show:?} {size:?} in {shown_px:?}: {error} levels");
                    worst = worst.max(error);
                }
            }
        }
    }
    let own = |point: &SurfacePoint| {
        let instance = case.scene.instances.get(point.instance as usize);
        instance.is_some_and(|i| point.local >= case.scene.template_ranges[i.template as usize].count)
    };
    bench.draw(&device, &case.camera.resized(64, 48), &RenderOptions::default());
    let seen = bench.surfaces.download().unwrap().iter().flatten().any(own);
    assert_eq!(seen, !case.scene.own.is_empty(), "own Gaussians are at the surface");
    worst
}

#[test]
fn windows_show_what_the_twin_says() {
    let Some(gpu) = gpu() else { return };
    let mut bench = Bench::new(&gpu);
    let case = random_case(4);
    let mut with_own = case.clone();
    add_own_gaussians(&mut Rng::new(4), &mut with_own);
    let worst = [&case, &with_own].map(|case| worst_level(&mut bench, case)).into_iter().fold(0.0, f64::max);
    println!("levels within {worst:.1e} of the twin's");
    assert_silent(&gpu);
}

/// Views of what is at the surface are the same however many depth slabs there are; the load is the last one's.
#[test]
fn depth_slabs_change_only_the_load() {
    let Some(gpu) = gpu() else { return };
    let mut bench = Bench::new(&gpu);
    let case = random_case(4);
    let device = bench.renderer.upload(&case.scene).unwrap();
    let chosen = vec![false; case.scene.instances.len()];
    bench.presenter.set_instances(&looks(&case.scene, &chosen)).unwrap();
    let camera = case.camera.resized(64, 48);
    let few = RenderOptions { max_intersections: Some(1), ..RenderOptions::default() };
    let views = views(5.0);
    let mut pictures = Vec::new();
    for options in [RenderOptions::default(), few] {
        let slabs = bench.draw(&device, &camera, &options);
        let all: Vec<_> = views.iter().map(|view| bench.pixels(&device, (view.0, true), ([64, 48], false))).collect();
        pictures.push((slabs, bench.read().tile_loads.iter().sum::<u32>(), all));
    }
    let [(one, all_pairs, whole), (slabs, last_pairs, parts)] = &pictures[..] else { unreachable!() };
    assert!(*one == 1 && *slabs > 2 && 0 < *last_pairs && last_pairs < all_pairs, "{slabs} slabs, {last_pairs} pairs");
    for ((view, whole), parts) in views.iter().zip(whole).zip(parts) {
        assert_eq!(whole == parts, !matches!(view.0, Show::TileLoad(_)), "{view:?}");
    }
    assert_silent(&gpu);
}

/// A window whose scene is still on its way is black in every view, and so are views that lack what they need.
#[test]
fn without_a_picture_the_window_is_black() {
    let Some(gpu) = gpu() else { return };
    let mut bench = Bench::new(&gpu);
    let case = random_case(4);
    let device = bench.renderer.upload(&case.scene).unwrap();
    for (show, _) in views(5.0) {
        assert_eq!(bench.pixels(&device, (show, false), ([5, 3], true)), [0; 45], "{show:?}");
    }
    bench.draw(&device, &case.camera.resized(20, 10), &RenderOptions::default());
    for (show, _) in views(5.0) {
        let dark = bench.pixels(&device, (show, false), ([20, 10], true)).iter().all(|&level| level == 0);
        assert_eq!(dark, show.needs_surfaces() || show.marks().is_some(), "{show:?}");
    }
    assert_silent(&gpu);
}

/// A scene without instances and one without anything have their views too.
#[test]
fn clouds_and_empty_scenes_have_their_views() {
    let Some(gpu) = gpu() else { return };
    let mut bench = Bench::new(&gpu);
    let case = random_case(4);
    let camera = case.camera.resized(40, 30);
    for scene in [InstancedScene::from_cloud(case.scene.templates.clone()), InstancedScene::default()] {
        let device = bench.renderer.upload(&scene).unwrap();
        bench.presenter.set_instances(&[]).unwrap();
        bench.draw(&device, &camera, &RenderOptions::default());
        let inputs = bench.read();
        for (show, twin_show) in views(5.0) {
            let want = inputs.shown(&scene, &[], twin_show).levels([40, 30]);
            assert!(error(&bench.pixels(&device, (show, true), ([40, 30], false)), &want) < TOLERANCE, "{show:?}");
        }
    }
    assert_silent(&gpu);
}

/// Offsets and colours that are no numbers, or too large for their squares: all views are as the twin has them.
#[test]
fn poison_offsets_do_not_spread() {
    let Some(gpu) = gpu() else { return };
    let mut bench = Bench::new(&gpu);
    let case = random_case(4);
    let camera = case.camera.resized(40, 30);
    let chosen = vec![true; case.scene.instances.len()];
    for (p, value) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 1e-42, 1e25].into_iter().enumerate() {
        let mut scene = case.scene.clone();
        assert!(scene.offsets.len() > 50);
        for i in (0..scene.offsets.len()).step_by(3) {
            match (i / 3 + p) % 3 {
                0 => scene.offsets.means[i][i % 3] = value,
                1 => scene.offsets.sh_dc[i][i % 3] = value,
                _ => scene.offsets.opacity_logits[i] = value,
            }
        }
        let device = bench.renderer.upload(&scene).unwrap();
        bench.presenter.set_instances(&looks(&scene, &chosen)).unwrap();
        bench.draw(&device, &camera, &RenderOptions::default());
        let inputs = bench.read();
        for (show, twin_show) in views(5.0) {
            let want = inputs.shown(&scene, &chosen, twin_show).levels([40, 30]);
            assert!(
                error(&bench.pixels(&device, (show, true), ([40, 30], false)), &want) < TOLERANCE,
                "{value}, {show:?}"
            );
        }
    }
    assert_silent(&gpu);
}
