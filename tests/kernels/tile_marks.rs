//! Kernel `tile_marks` against its twin: random scenes, in one piece and in depth slabs, and poison.

use instgs_reference::preprocess_instance_expand::sources;
use instgs_reference::tile_blend::relaxed_limits;
use instgs_reference::tile_marks::{self as twin, Mark, marks};
use instgs_reference::{self, View, splats_in_depth_order};
use instgs_vk::render::{MarkShape, Marks, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, InstancedScene};

use crate::common::gpu::{assert_silent, device_options, gpu};
use crate::common::random_scene::random_case;

const SHAPES: [(MarkShape, twin::MarkShape); 3] = [
    (MarkShape::Points, twin::MarkShape::Points),
    (MarkShape::Ellipses(0.0), twin::MarkShape::Ellipses(0.0)),
    (MarkShape::Ellipses(0.25), twin::MarkShape::Ellipses(0.25)),
];

/// How far beyond a rounding border a level may be: colours are within 1e-4 of the twin's (0.03 levels), and the square of the
/// distance from the centre within a thousandth (0.17 levels).
const TOLERANCE: f64 = 0.2;

fn want(
    scene: &InstancedScene,
    camera: &Camera,
    options: &instgs_reference::RenderOptions,
    shape: twin::MarkShape,
) -> Vec<Mark> {
    let view = View::device(camera, options);
    marks(&view, &splats_in_depth_order(&sources(scene), &view, &relaxed_limits(&view)), shape)
}

/// Compared pixels with a mark, without one, and fragile ones.
fn compare(got: &[Option<[u8; 3]>], want: &[Mark], what: &str) -> [usize; 3] {
    assert_eq!(got.len(), want.len());
    let mut counts = [0; 3];
    for (i, (got, want)) in got.iter().zip(want).enumerate() {
        if !want.robust {
            counts[2] += 1;
            continue;
        }
        assert_eq!(got.is_some(), want.levels.is_some(), "{what}, pixel {i}: {got:?} for {want:?}");
        counts[usize::from(got.is_none())] += 1;
        for (got, want) in got.iter().flatten().zip(want.levels.iter().flatten()) {
            let error = (f64::from(*got) - want).abs() - 0.5;
            assert!(error < TOLERANCE, "{what}, pixel {i}: {got} for {want}");
        }
    }
    counts
}

#[test]
fn marks_are_what_the_twin_says_and_slabs_change_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let mut on_device = Marks::new(&gpu).unwrap();
    let (mut counts, mut slabs) = ([0; 3], 0);
    for seed in 0..12 {
        let case = random_case(seed);
        let device = renderer.upload(&case.scene).unwrap();
        let options = device_options(&case.options);
        let few = RenderOptions { max_intersections: Some(1), ..options };
        for (shape, twin_shape) in SHAPES {
            renderer.render_with_marks(&device, &case.camera, &options, &mut on_device, shape, None).unwrap();
            let got = on_device.download().unwrap();
            let want = want(&case.scene, &case.camera, &case.options, twin_shape);
            let new = compare(&got, &want, &format!("seed {seed}, {shape:?}"));
            counts.iter_mut().zip(new).for_each(|(sum, n)| *sum += n);
            let stats = renderer.render_with_marks(&device, &case.camera, &few, &mut on_device, shape, None).unwrap();
            assert!(on_device.download().unwrap() == got, "seed {seed}, {shape:?}: {} slabs", stats.slabs);
            slabs = slabs.max(stats.slabs);
        }
    }
    let [marked, empty, fragile] = counts;
    println!("{marked} marked pixels, {empty} without, {fragile} fragile, up to {slabs} slabs");
    assert!(marked > 10_000 && empty > 10_000 && 20 * fragile < marked && slabs > 2);
    assert_silent(&gpu);
}

/// Poison in some Gaussians leaves the marks of the others as the twin has them; an empty scene has none.
#[test]
fn poison_marks_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let mut on_device = Marks::new(&gpu).unwrap();
    let case = random_case(4);
    let device = renderer.upload(&InstancedScene::default()).unwrap();
    let shape = MarkShape::Ellipses(0.0);
    renderer
        .render_with_marks(&device, &case.camera, &device_options(&case.options), &mut on_device, shape, None)
        .unwrap();
    assert!(on_device.download().unwrap().iter().all(Option::is_none));
    for (p, value) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX].into_iter().enumerate() {
        let mut scene = case.scene.clone();
        let templates = &mut scene.templates;
        let coefficients = templates.sh_coefficients();
        for i in (0..templates.len()).step_by(5) {
            match (i / 5 + p) % 5 {
                0 => templates.means[i][i % 3] = value,
                1 => templates.quats[i] = [value; 4],
                2 => templates.log_scales[i][i % 3] = value,
                3 => templates.opacity_logits[i] = -value,
                _ => templates.sh[i * coefficients][i % 3] = value,
            }
        }
        let device = renderer.upload(&scene).unwrap();
        for (shape, twin_shape) in SHAPES {
            renderer
                .render_with_marks(&device, &case.camera, &device_options(&case.options), &mut on_device, shape, None)
                .unwrap();
            let want = want(&scene, &case.camera, &case.options, twin_shape);
            let counts = compare(&on_device.download().unwrap(), &want, &format!("{value}, {shape:?}"));
            assert!(counts[0] > 100, "{value}, {shape:?}: {counts:?}");
        }
    }
    assert_silent(&gpu);
}
