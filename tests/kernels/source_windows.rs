//! Scenes whose arrays are larger than a binding: pictures and training have the same bytes as where all can be bound at once.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use instgs_train::device_state::DeviceState;
use instgs_train::state_file::to_checkpoint;
use instgs_vk::gpu::staging::write;
use instgs_vk::gpu::{Buffer, Gpu, GpuError, Grid, Home, Pipeline, PipelineCache, Recorder};
use instgs_vk::kernels::{Variant, reset_opacity};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{DeviceScene, RenderError, RenderOptions, Renderer};
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::instanced_scene::SAME_COLOR;
use instgs_vk::scene::{Camera, DevicePrecision, Gaussians, Instance, InstancedScene, Offsets, SourceRange};

use crate::backward::{compare, cotangents};
use crate::common::gpu::{assert_silent, gpu_with_small_chunks, with_bindings_of};
use crate::common::gpu_gradients::GradientRunner;
use crate::common::random_scene::{RandomCase, rare_case};
use crate::common::tensor::TensorComparison;
use crate::densify_own::case_with_own;
use crate::train_steps::{Data, bits, in_turn, instanced};
use crate::{densify, mcmc, train_steps};

/// Small Gaussians in heaps of 32, front to back: where there are too many chunks for a buffer, depth ranges can take them apart.
fn cloud(rng: &mut Rng, count: usize, sh_degree: u32, radius: f64) -> Gaussians {
    let mut heap = DVec3::ZERO;
    let place = |k: usize| {
        if k.is_multiple_of(32) {
            heap = rng.unit_vector() * DVec3::new(radius, radius, 0.0);
            heap.z = (2.0 * k as f64 / count as f64 - 1.0) * radius;
        }
        (heap + 0.05 * rng.normal_vector()).as_vec3().to_array()
    };
    let means = (0..count).map(place).collect();
    let mut numbers =
        |count: usize, scale: f64| -> Vec<f32> { (0..count).map(|_| (scale * rng.normal()) as f32).collect() };
    let threes = |numbers: Vec<f32>| numbers.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect();
    Gaussians {
        means,
        quats: numbers(4 * count, 1.0).chunks_exact(4).map(|v| [v[0], v[1], v[2], v[3]]).collect(),
        log_scales: numbers(3 * count, 0.3).chunks_exact(3).map(|v| [0, 1, 2].map(|k| v[k] - 4.0)).collect(),
        opacity_logits: numbers(count, 2.0),
        sh_degree,
        sh: threes(numbers(3 * count * sh_coefficients(sh_degree), 0.3)),
    }
}

/// Two templates, own Gaussians, offsets, and a background of another SH degree. With bindings of 2 MiB it takes several windows,
/// one of which begins among the templates and ends in the background.
fn scene(seed: u64, degrees: [u32; 2], counts: [u32; 2]) -> InstancedScene {
    let mut rng = Rng::new(seed);
    let templates = cloud(&mut rng, (counts[0] + counts[1]) as usize, degrees[0], 0.4);
    let records = counts.iter().sum::<u32>() as usize;
    let place = |template: u32, x: f64| Instance {
        template,
        world_from_template: Similarity::from_parts(DMat3::IDENTITY, 1.0, DVec3::new(x, 0.0, 0.2 * x)),
        first_offset: Some(if template == 0 { 0 } else { counts[0] }),
    };
    let mut vectors = || (0..records).map(|_| (0.02 * rng.normal_vector()).as_vec3().to_array()).collect();
    let offsets =
        Offsets { means: vectors(), sh_dc: vectors(), opacity_logits: vec![0.3; records], ..Offsets::default() };
    let own = cloud(&mut rng, 500, degrees[0], 0.3);
    let none = SourceRange { first: 0, count: 0 };
    let scene = InstancedScene {
        templates,
        template_ranges: vec![
            SourceRange { first: 0, count: counts[0] },
            SourceRange { first: counts[0], count: counts[1] },
        ],
        instances: vec![place(0, -0.8), place(1, 0.0), place(0, 0.8)],
        offsets,
        own,
        own_ranges: vec![none, SourceRange { first: 0, count: 500 }, none],
        background: cloud(&mut rng, 50_000, degrees[1], 1.0),
        ..InstancedScene::default()
    };
    scene.validate().unwrap();
    scene
}

#[test]
fn pictures_in_windows_have_the_same_bytes() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let small = with_bindings_of(&gpu, 2 << 20);
    let camera = Camera::look_at("ahead", DVec3::new(0.3, -0.2, -3.0), DVec3::ZERO, DVec3::NEG_Y, 0.8, (72, 56));
    let (mut whole, mut windowed) = (Renderer::new(&gpu).unwrap(), Renderer::new(&small).unwrap());
    let (f32, f16, q8) = (DevicePrecision::F32, DevicePrecision::F16, DevicePrecision::Q8);
    let cases = [
        (1, [3, 3], [9000, 3000], &[(f32, 0.0), (f16, 2.0)][..]),
        (2, [2, 3], [40, 700], &[(q8, 0.0)]),
        (3, [3, 0], [20_000, 15_000], &[(f16, 0.0)]),
    ];
    for (seed, degrees, counts, kinds) in cases {
        let scene = scene(seed, degrees, counts);
        for &(precision, lod_error_px) in kinds {
            let options = RenderOptions { device_precision: precision, lod_error_px, ..RenderOptions::default() };
            let on_device = whole.upload_for(&scene, &options).unwrap();
            assert!(!on_device.windows.are_several());
            whole.render(&on_device, &camera, &options).unwrap();
            let want = whole.download().unwrap();
            let on_device = windowed.upload_for(&scene, &options).unwrap();
            assert!(on_device.windows.iter().count() > 1, "seed {seed}");
            for occlusion in [false, true] {
                windowed.render(&on_device, &camera, &RenderOptions { occlusion, ..options }).unwrap();
                assert!(
                    windowed.download().unwrap() == want,
                    "seed {seed}, {precision:?}, lod {lod_error_px}, {occlusion}"
                );
            }
        }
        // The last window is seen where nothing is before it: without its Gaussians the picture is another.
        let mut last = scene.clone();
        last.background.opacity_logits[..45_000].fill(-20.0);
        let mut less = last.clone();
        less.background.opacity_logits[45_000..].fill(-20.0);
        let [last, less] = [&last, &less].map(|scene| {
            let on_device = windowed.upload(scene).unwrap();
            windowed.render(&on_device, &camera, &RenderOptions::default()).unwrap();
            windowed.download().unwrap()
        });
        assert!(last != less);
    }
    assert_silent(&gpu);
    assert_silent(&small);
}

/// A scene that takes most of a budget, or more than that, stays in host memory if frames may be divided, and looks the same; what
/// a frame takes besides stays within the budget.
#[test]
fn scenes_larger_than_the_memory_stay_on_the_host() {
    let Some(shared) = gpu_with_small_chunks() else { return };
    let gpu = with_bindings_of(&shared, u64::MAX);
    let scene = scene(1, [3, 3], [9000, 3000]);
    let camera = Camera::look_at("ahead", DVec3::new(0.3, -0.2, -3.0), DVec3::ZERO, DVec3::NEG_Y, 0.8, (72, 56));
    let mut renderer = Renderer::new(&gpu).unwrap();
    for (device_precision, lod_error_px) in [(DevicePrecision::F32, 0.0), (DevicePrecision::F16, 2.0)] {
        let whole = RenderOptions { device_precision, lod_error_px, ..RenderOptions::default() };
        let divided = RenderOptions { divide_for_memory: true, ..whole };
        gpu.set_memory_budget(u64::MAX);
        let on_device = renderer.upload_for(&scene, &divided).unwrap();
        assert_eq!(on_device.host_bytes(), 0, "there is room");
        renderer.render(&on_device, &camera, &whole).unwrap();
        let want = renderer.download().unwrap();
        let bytes = on_device.bytes();
        drop(on_device);
        renderer.forget_picture();
        let (before, _) = gpu.memory_usage();
        // Less than the scene has.
        let budget = before + bytes * 7 / 8;
        gpu.set_memory_budget(budget);
        gpu.reset_memory_peak();
        let on_host = renderer.upload_for(&scene, &divided).unwrap();
        assert_eq!((on_host.home, on_host.bytes()), (Home::Host, bytes));
        assert!(on_host.host_bytes() * 10 > bytes * 9, "all but instances and chunks");
        renderer.render(&on_host, &camera, &divided).unwrap();
        assert!(renderer.download().unwrap() == want, "{device_precision:?}, lod {lod_error_px}");
        assert!(gpu.memory_usage().1 <= budget);
        drop(on_host);
        renderer.forget_picture();
        assert_eq!(gpu.memory_usage().0, before, "all is freed, and nothing of the host's");
        // Whoever does not ask for it is told.
        let error = renderer.upload_for(&scene, &whole).err().unwrap();
        assert!(matches!(error, RenderError::Gpu(GpuError::OutOfMemory { .. })), "{error}");
    }
    assert_silent(&gpu);
}

/// A cloud of which seven of eight Gaussians are too transparent to be seen.
fn mostly_hidden(rng: &mut Rng, count: usize, sh_degree: u32) -> Gaussians {
    let mut out = cloud(rng, count, sh_degree, 1.5);
    let hidden = out.opacity_logits.iter_mut().enumerate().filter(|(k, _)| k % 8 != 0);
    hidden.for_each(|(_, logit)| *logit -= 20.0);
    out
}

/// The scene with many more Gaussians in its background.
fn with_many_more(scene: &InstancedScene, seed: u64) -> InstancedScene {
    let mut out = scene.clone();
    out.background = mostly_hidden(&mut Rng::new(seed), 2400, 3);
    out.validate().unwrap();
    out
}

/// The scene with one more template of many Gaussians, and an instance of it.
fn with_large_template(scene: &InstancedScene, seed: u64) -> InstancedScene {
    let mut out = scene.clone();
    let first = out.templates.len() as u32;
    let mut rng = Rng::new(seed);
    // Templates come first: what is added lies behind them, in more than one window.
    out.templates.append(&mostly_hidden(&mut rng, 2600, scene.templates.sh_degree));
    out.template_ranges.push(SourceRange { first, count: 2600 });
    let place = Similarity::from_parts(DMat3::IDENTITY, 0.7, out.instances[0].world_from_template.translation());
    let template = out.template_ranges.len() as u32 - 1;
    out.instances.push(Instance { template, world_from_template: place, first_offset: None });
    if let Some(&matrix) = out.color_from_template.first() {
        out.color_from_template.push(matrix);
    }
    if !out.own_ranges.is_empty() {
        out.own_ranges.push(SourceRange { first: out.own.len() as u32, count: 0 });
    }
    out.validate().unwrap();
    out
}

/// Gradients with bindings of 160 KiB, in two windows, are those of one up to rounding, as the kernels are compiled anew. Measured
/// on lavapipe: no difference.
#[test]
fn gradients_in_windows_are_the_same() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let small = with_bindings_of(&gpu, 160 << 10);
    let variant = Variant::for_training(gpu.caps());
    let [mut whole, mut windowed] = [&gpu, &small].map(|gpu| GradientRunner::new(gpu, variant));
    let (mut worst, mut seen_behind, mut large_templates): (f64, usize, usize) = (0.0, 0, 0);
    // Pictures whose moments such a binding holds.
    let is_small = |case: &RandomCase| case.camera.width * case.camera.height < 3400;
    for mut case in (0..).map(rare_case).filter(is_small).take(12) {
        let seed = case.seed;
        // Beyond the first window: the background, or a template whose instance has a colour matrix if others have one.
        case.scene = match case.scene.templates.sh_degree {
            3 => with_large_template(&case.scene, seed),
            _ => with_many_more(&case.scene, seed),
        };
        large_templates += usize::from(case.scene.templates.len() > 2600);
        let cotangents = cotangents(&case);
        let [want, got] = [&mut whole, &mut windowed].map(|runner| {
            runner.set_intersections(3000);
            runner.run(&case.scene, &case.camera, &case.options, &cotangents)
        });
        let chunk_size = variant.workgroup_size;
        assert!(DeviceScene::unbounded(&small, &case.scene, chunk_size).unwrap().windows.are_several());
        assert!(got.colors == want.colors, "seed {seed}");
        for comparison in compare(&got.gradient, &want.gradient) {
            worst = worst.max(comparison.relative_l2);
            comparison.check(1e-5).unwrap();
        }
        let flat =
            |statistics: &[[f32; 3]]| statistics.as_flattened().iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let [got, want] = [flat(&got.screen_statistics), flat(&want.screen_statistics)];
        seen_behind += usize::from(want[3 * 1700..].iter().any(|&v| v > 0.0));
        TensorComparison::new("statistics", &got, &want).check(1e-5).unwrap();
    }
    println!("relative L2 error {worst:.1e}; Gaussians behind the first window are seen in {seen_behind} scenes");
    println!("{large_templates} with large templates");
    assert!(seen_behind > 6 && large_templates > 1);
    assert_silent(&gpu);
    assert_silent(&small);
}

/// Steps in two windows: the same bytes twice, and the losses of steps in one up to rounding.
#[test]
fn training_in_windows_is_repeatable_and_learns() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let small = with_bindings_of(&gpu, 160 << 10);
    let (truth, start, target) = instanced();
    let data = Data::of(&with_many_more(&truth, 5), target);
    let start = with_many_more(&start, 6);
    let run = |gpu: &Arc<Gpu>| train_steps::run(gpu, &start, &data, Some(3000), (12, 3, in_turn));
    let (whole, windowed) = (run(&gpu), run(&small));
    assert!(bits(&run(&small).scene) == bits(&windowed.scene));
    let losses = |run: &train_steps::Run| run.outcomes.iter().map(|o| o.mse).collect::<Vec<_>>();
    let (whole, windowed) = (losses(&whole), losses(&windowed));
    for (a, b) in windowed.iter().zip(&whole) {
        // Where a gradient is all rounding, Adam follows it.
        let allowed = if gpu.caps().is_llvmpipe { 0.0 } else { 0.02 };
        assert!((a - b).abs() <= allowed * b, "{windowed:?}\n{whole:?}");
    }
    assert!(windowed[9] < 0.9 * windowed[0], "{windowed:?}");
    assert_silent(&gpu);
    assert_silent(&small);
}

/// Both strategies with bindings of 160 KiB, and clouds that grow from one window, or from two, into more.
#[test]
fn growth_in_windows_has_the_same_bytes() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let small = with_bindings_of(&gpu, 160 << 10);
    for (seed, count) in [(81, 1700), (82, 2500)] {
        let case = densify::random_case(seed, count, 3);
        let config = densify::config(&["max_gaussians=3800"]);
        let (whole, windowed) = [&gpu, &small].map(|gpu| densify::run(gpu, &case, &config, 200)).into();
        assert_eq!(windowed.0, whole.0);
        assert!(whole.0.gaussians > 1950, "{}", whole.0.gaussians);
        assert!(windowed.1 == whole.1, "densify, seed {seed}");
        let config = mcmc::mcmc_config(&["max_gaussians=3800"]);
        let (whole, windowed) = [&gpu, &small].map(|gpu| mcmc::run(gpu, &mcmc::case(seed, count, 3), &config)).into();
        assert_eq!(windowed.0, whole.0);
        assert!(windowed.1 == whole.1, "mcmc, seed {seed}");
    }
    assert_silent(&gpu);
    assert_silent(&small);
}

/// Growth of templates, of single instances and of the background, with bindings of 256 KiB; then what instances show is larger
/// than a binding.
#[test]
fn scenes_of_instances_grow_in_windows() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let small = with_bindings_of(&gpu, 256 << 10);
    let more = densify::random_case(91, 3700, 2);
    for of_template in [false, true] {
        let (mut scene, mut case, records) = case_with_own(12, 2);
        if of_template {
            // A third template: Gaussians of single instances lie behind it, in the second window.
            scene.template_ranges.push(SourceRange { first: scene.templates.len() as u32, count: 3700 });
            let own_and_background = case.statistics.split_off(scene.templates.len());
            case.statistics.extend(more.statistics.iter().chain(&own_and_background));
            scene.templates.append(&more.cloud);
            let place = scene.instances[0].world_from_template;
            scene.instances.push(Instance { template: 2, world_from_template: place, first_offset: None });
            scene.color_from_template.push(SAME_COLOR);
            scene.own_ranges.push(SourceRange { first: scene.own.len() as u32, count: 0 });
        } else {
            scene.background.append(&more.cloud);
            case.statistics.extend(&more.statistics);
        }
        scene.validate().unwrap();
        let cap = if of_template { "max_gaussians=6500" } else { "max_gaussians=6000" };
        let config = densify::config(&[cap, "joint.own_share=0.5"]);
        let chunk_size = Variant::for_training(gpu.caps()).workgroup_size;
        let [whole, windowed] = [&gpu, &small].map(|gpu| {
            let mut state = DeviceState::new(gpu, &scene, chunk_size).unwrap();
            assert_eq!(state.scene.windows.are_several(), Arc::ptr_eq(gpu, &small));
            write(gpu, &mut state.gradients.screen_statistics, &case.statistics).unwrap();
            write(gpu, &mut state.gradients.record_statistics, &records).unwrap();
            let extent = densify::EXTENT;
            let outcome = densify::strategy(gpu, 2).after_step(&mut state, &config, 400, extent).unwrap().unwrap();
            assert!(outcome.own > 50 && outcome.cloned + outcome.split > 100, "{outcome:?}");
            let grown = state.download(gpu).unwrap();
            let first_own = grown.templates.len() as u32;
            let second = state.scene.windows.iter().nth(1).map_or(u32::MAX, |window| window.shown.first);
            assert!(!of_template || second == u32::MAX || first_own + grown.own.len() as u32 > second, "{first_own}");
            (grown, to_checkpoint(gpu, &mut state, 400, false).unwrap())
        });
        assert!(windowed == whole, "{of_template}");
    }
    assert_silent(&gpu);
    assert_silent(&small);
}

/// What does not fit a binding is refused, not bound in part.
#[test]
fn whole_buffers_have_to_fit_a_binding() {
    let Some(gpu) = gpu_with_small_chunks() else { return };
    let small = with_bindings_of(&gpu, 160 << 10);
    let mut large = Buffer::<u32>::in_parts(&small, "large", 41_000, Home::Device).unwrap();
    let mut recorder = Recorder::new(&small).unwrap();
    recorder.fill(&mut large, 1).unwrap();
    let error = Buffer::<u32>::new(&small, "whole", 41_000).err().unwrap().to_string();
    assert!(error.contains("maxStorageBufferRange") && error.contains("164000"), "{error}");
    let cache = PipelineCache::new(&small, None).unwrap();
    let size = small.caps().subgroup_sizes()[0];
    let constants = [("WORKGROUP_SIZE", 32)];
    let pipeline = Pipeline::<reset_opacity::ResetOpacity>::new(&small, &cache, size, &constants).unwrap();
    let mut moments = Buffer::new(&small, "moments", 1).unwrap();
    let mut logits = Buffer::<f32>::in_parts(&small, "logits", 41_000, Home::Device).unwrap();
    let bindings = reset_opacity::Bindings { opacity_logits: &mut logits, moments: &mut moments };
    let params = reset_opacity::Params { count: 1, logit_max: 0.0 };
    let error = recorder.dispatch(&pipeline, Grid::groups(1), &params, bindings).unwrap_err().to_string();
    assert!(error.contains("164000 bytes of buffer logits; a binding has at most 163840"), "{error}");
    assert_silent(&small);
}
