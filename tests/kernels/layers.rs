//! Frames in depth layers: the same bytes as in one piece, without the work for what is hidden.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use instgs_reference::layers as twin;
use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::staging::{download, upload};
use instgs_vk::gpu::{Buffer, DeviceChoice, Gpu, GpuError, GpuOptions, Grid, PipelineCache, Recorder};
use instgs_vk::kernels::pipelines::LayerPipelines;
use instgs_vk::kernels::{Pipelines, Purpose, SceneTraits, Variant, close_tiles, next_layer, plan_layers};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::forward::read_counters;
use instgs_vk::render::plan::Capacities;
use instgs_vk::render::{Ahead, Arrived, ExtraPasses, RenderError, RenderOptions, Renderer, Surfaces};
use instgs_vk::scene::{Camera, DevicePrecision, Gaussians, Instance, InstancedScene, SourceRange};

use crate::common::gpu::{assert_silent, device_options, gpu};
use crate::common::random_scene::{random_case, rare_case};

/// Everything of the frames in layers that scenes can have: offsets, colours, own Gaussians, all precisions.
#[test]
fn layers_change_no_bit() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let (mut whole_pairs, mut layered_pairs) = (0, 0);
    for case in (0..40).map(random_case).chain((0..20).map(rare_case)) {
        let precision = DevicePrecision::ALL[case.seed as usize % DevicePrecision::ALL.len()];
        let whole = RenderOptions { device_precision: precision, ..device_options(&case.options) };
        let layered = RenderOptions { occlusion: true, ..whole };
        // Large and opaque enough to hide something, also where tiles are of 16 pixels.
        let mut opaque = case.scene.clone();
        for cloud in [&mut opaque.templates, &mut opaque.background] {
            cloud.opacity_logits.iter_mut().for_each(|logit| *logit += 8.0);
            cloud.log_scales.iter_mut().flatten().for_each(|scale| *scale += 0.5);
        }
        for scene in [&case.scene, &opaque] {
            let scene = renderer.upload_for(scene, &whole).unwrap();
            whole_pairs += renderer.render(&scene, &case.camera, &whole).unwrap().intersections;
            let want = renderer.download().unwrap();
            layered_pairs += renderer.render(&scene, &case.camera, &layered).unwrap().intersections;
            assert!(renderer.download().unwrap() == want, "seed {}, {precision:?}", case.seed);
        }
    }
    println!("{layered_pairs} of {whole_pairs} pairs");
    assert!(layered_pairs < whole_pairs, "nothing was hidden");
    assert_silent(&gpu);
}

/// Appends an opaque splat of SH degree 1.
fn push_splat(cloud: &mut Gaussians, rng: &mut Rng, mean: DVec3, sigma: f32) {
    cloud.means.push(mean.as_vec3().to_array());
    cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
    cloud.log_scales.push([sigma.ln(); 3]);
    cloud.opacity_logits.push(6.0);
    (0..4).for_each(|_| cloud.sh.push([0; 3].map(|_| rng.range(-0.3, 0.3) as f32)));
}

/// A wall across the view, and `behind` instances of a ball of 300 splats behind it.
fn wall(behind: usize) -> (InstancedScene, Camera) {
    let mut rng = Rng::new(5);
    let mut templates = Gaussians::with_capacity(1, 0);
    // Six sheets of splats: alpha is at most 0.99, so a pixel ends with the third.
    let side = 24;
    for k in 0..6 * side * side {
        let [x, y, z] = [k % side, k / side % side, k / side / side].map(f64::from);
        let across = |v: f64| (v + 0.5) / f64::from(side) - 0.5;
        push_splat(&mut templates, &mut rng, DVec3::new(across(x), across(y), 0.002 * z), 0.03);
    }
    let sheets = SourceRange { first: 0, count: templates.len() as u32 };
    for _ in 0..300 {
        let mean = 0.1 * rng.unit_vector();
        push_splat(&mut templates, &mut rng, mean, 0.007);
    }
    let ball = SourceRange { first: sheets.count, count: 300 };
    let at = |place: DVec3, template: u32| Instance {
        template,
        world_from_template: Similarity::from_parts(DMat3::IDENTITY, 1.0, place),
        first_offset: None,
    };
    let mut instances = vec![at(DVec3::Z, 0)];
    for _ in 0..behind {
        let z = rng.range(2.0, 12.0);
        let [x, y] = [0; 2].map(|_| rng.range(-0.4, 0.4) * z);
        instances.push(at(DVec3::new(x, y, z), 1));
    }
    let scene =
        InstancedScene { templates, template_ranges: vec![sheets, ball], instances, ..InstancedScene::default() };
    scene.validate().unwrap();
    let camera = Camera::look_at("wall", DVec3::ZERO, DVec3::Z, DVec3::Y, 0.7, (93, 61));
    (scene, camera)
}

#[test]
fn what_a_wall_hides_is_not_expanded() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = wall(400);
    let mut renderer = Renderer::new(&gpu).unwrap();
    let whole = RenderOptions::default();
    let scene = renderer.upload(&scene).unwrap();
    let all = renderer.render(&scene, &camera, &whole).unwrap();
    let want = renderer.download().unwrap();
    let layered = RenderOptions { occlusion: true, ..whole };
    let seen = renderer.render(&scene, &camera, &layered).unwrap();
    assert!(renderer.download().unwrap() == want);
    println!("{} of {} chunks, {} of {} splats", seen.work_items, all.work_items, seen.visible, all.visible);
    // The wall is most of the first layers; 400 balls of 300 Gaussians are behind it.
    assert!(seen.work_items * 3 < all.work_items, "{} of {} chunks", seen.work_items, all.work_items);
    assert!(seen.visible * 3 < all.visible, "{} of {} splats", seen.visible, all.visible);
    // The same after pictures of other kinds with the same renderer.
    renderer.render(&scene, &camera, &whole).unwrap();
    assert_eq!(renderer.render(&scene, &camera, &layered).unwrap().work_items, seen.work_items);
    assert!(renderer.download().unwrap() == want);
    assert_silent(&gpu);
}

/// A frame with more visible chunks than a buffer may have is drawn in depth ranges, and has the same bytes.
#[test]
fn more_chunks_than_fit_are_drawn_in_ranges() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let (mut ranges, mut too_many) = (0, 0);
    for case in (0..30).map(random_case).chain((0..10).map(rare_case)) {
        let precision = DevicePrecision::ALL[case.seed as usize % DevicePrecision::ALL.len()];
        let whole = RenderOptions { device_precision: precision, ..device_options(&case.options) };
        let scene = renderer.upload_for(&case.scene, &whole).unwrap();
        let all = renderer.render(&scene, &case.camera, &whole).unwrap();
        let want = renderer.download().unwrap();
        let few = RenderOptions { max_chunks: Some((all.work_items - 1).max(1) as u32), ..whole };
        // Chunks that reach through one depth cannot be taken apart.
        match renderer.render(&scene, &case.camera, &few) {
            Ok(stats) => {
                ranges += stats.layers - 1;
                assert!(renderer.download().unwrap() == want, "seed {}, {precision:?}", case.seed);
            }
            Err(error) => {
                assert!(error.to_string().contains("visible chunks reach through one depth"), "{error}");
                too_many += 1;
            }
        }
        renderer.render(&scene, &case.camera, &whole).unwrap();
        assert!(renderer.download().unwrap() == want, "in one piece again, seed {}", case.seed);
    }
    println!("{ranges} ranges besides the first, {too_many} of 40 do not fit");
    assert!(ranges > 5, "{ranges}");
    assert_silent(&gpu);
}

/// Ranges are as small as it takes, hide what is behind them, and a renderer that has drawn them draws other frames as before.
#[test]
fn ranges_are_as_small_as_it_takes() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = wall(400);
    let mut balls = scene.clone();
    balls.instances.remove(0);
    let mut renderer = Renderer::new(&gpu).unwrap();
    let whole = RenderOptions::default();
    for (scene, hides) in [(&scene, true), (&balls, false)] {
        let scene = renderer.upload(scene).unwrap();
        renderer.forget_picture();
        let all = renderer.render(&scene, &camera, &whole).unwrap();
        let want = renderer.download().unwrap();
        for part in [2, 5] {
            let most = (all.work_items / part) as u32;
            let few = RenderOptions { max_chunks: Some(most), ..whole };
            renderer.forget_picture();
            for _ in 0..2 {
                let stats = renderer.render(&scene, &camera, &few).unwrap();
                assert!(renderer.download().unwrap() == want, "a {part}th");
                println!(
                    "{} chunks at most of {}: {} in {} ranges",
                    most, all.work_items, stats.work_items, stats.layers
                );
                assert!(stats.layers > 1 && (hides || stats.work_items >= all.work_items));
                assert!(!hides || stats.work_items * 2 < all.work_items);
                assert!(stats.layers <= 6 * part as u32);
            }
            // With room again: in ranges once more where they filled the buffers, and then in one piece.
            renderer.render(&scene, &camera, &whole).unwrap();
            assert_eq!(renderer.render(&scene, &camera, &whole).unwrap().layers, 1);
            assert!(renderer.download().unwrap() == want);
        }
    }
    let scene = renderer.upload(&balls).unwrap();
    let none = RenderOptions { max_chunks: Some(1), ..whole };
    let error = renderer.render(&scene, &camera, &none).unwrap_err().to_string();
    assert!(error.contains("max_chunks") && error.contains("visible chunks reach through one depth"), "{error}");
    // Passes besides the blend want whole lists.
    let few = RenderOptions { max_chunks: Some(5), ..whole };
    renderer.forget_picture();
    let mut surfaces = Surfaces::new(&gpu).unwrap();
    let error = renderer.render_with_surfaces(&scene, &camera, &few, &mut surfaces).unwrap_err().to_string();
    assert!(error.contains("visible chunks") && error.contains("at most 5"), "{error}");
    assert_silent(&gpu);
}

/// The times of a frame in ranges include those of the passes that only count, also of ranges that turn out too large.
#[test]
fn counting_is_part_of_the_times_of_ranges() {
    let Some(gpu) = gpu() else { return };
    let (mut balls, camera) = wall(400);
    balls.instances.remove(0);
    let mut renderer = Renderer::profiled(&gpu).unwrap();
    let scene = renderer.upload(&balls).unwrap();
    let whole = RenderOptions::default();
    let all = renderer.render(&scene, &camera, &whole).unwrap();
    if all.total_ms().is_none() {
        return println!("skipped: the queue has no timestamps");
    }
    let few = RenderOptions { max_chunks: Some((all.work_items / 2) as u32), ..whole };
    renderer.forget_picture();
    // The second is drawn in ranges from the start.
    for _ in 0..2 {
        let stats = renderer.render(&scene, &camera, &few).unwrap();
        assert!(stats.in_ranges && stats.layers > 1);
        let count = |pass: &str| stats.passes_ms.iter().filter(|(name, _)| *name == pass).count() as u32;
        assert_eq!([count("cull_instances"), count("layer_histogram"), count("plan_layers")], [1; 3]);
        // All chunks together do not fit, so that one range at least was counted and then divided.
        assert!(count("cull_chunks") > stats.layers, "{} of {} ranges", count("cull_chunks"), stats.layers);
        assert!(count("close_tiles") >= stats.layers - 1);
    }
    assert_silent(&gpu);
}

/// Where memory runs out before bindings do, a frame is drawn in depth slabs and ranges, too.
#[test]
fn little_memory_leads_to_ranges() {
    let Some(shared) = gpu() else { return };
    let options =
        GpuOptions { device: DeviceChoice::Name(shared.caps().name.clone()), validation: true, ..Default::default() };
    let gpu = Gpu::open(&options).unwrap();
    let (mut balls, camera) = wall(400);
    balls.instances.remove(0);
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = renderer.upload(&balls).unwrap();
    let whole = RenderOptions::default();
    let divided = RenderOptions { divide_for_memory: true, ..whole };
    renderer.render(&scene, &camera, &whole).unwrap();
    let want = renderer.download().unwrap();
    renderer.forget_picture();
    let (without, _) = gpu.memory_usage();
    gpu.reset_memory_peak();
    // The first frame finds out how large the buffers have to be.
    (0..2).for_each(|_| drop(renderer.render(&scene, &camera, &whole).unwrap()));
    drop(renderer.download().unwrap());
    let of_frame = gpu.memory_usage().1 - without;
    let out_of_memory = |error: &RenderError| matches!(error, RenderError::Gpu(GpuError::OutOfMemory { .. }));
    let (mut in_ranges, mut most_refused) = (0, 0);
    for twentieth in 1..=20 {
        let budget = without + of_frame * twentieth / 20;
        renderer.forget_picture();
        gpu.set_memory_budget(budget);
        gpu.reset_memory_peak();
        for _ in 0..2 {
            match renderer.render(&scene, &camera, &divided) {
                Ok(stats) => {
                    assert_eq!(stats.in_ranges, stats.layers > 1);
                    in_ranges += u32::from(stats.in_ranges);
                    println!("{twentieth} twentieths: {} ranges, {} slabs", stats.layers, stats.slabs);
                }
                Err(error) => {
                    assert!(out_of_memory(&error), "{error}");
                    most_refused = twentieth;
                    continue;
                }
            }
            assert!(renderer.download().unwrap() == want, "{twentieth} twentieths");
            assert!(gpu.memory_usage().1 <= budget);
        }
    }
    assert!(in_ranges >= 12 && most_refused <= 3, "{in_ranges} in ranges, refused at {most_refused} twentieths");
    // Only frames that may be are divided.
    renderer.forget_picture();
    gpu.set_memory_budget(without + of_frame / 2);
    assert!(renderer.render(&scene, &camera, &divided).unwrap().in_ranges);
    let error = renderer.render(&scene, &camera, &whole).unwrap_err();
    assert!(out_of_memory(&error), "{error}");
    gpu.set_memory_budget(u64::MAX);
    assert!(!renderer.render(&scene, &camera, &whole).unwrap().in_ranges);
    assert!(renderer.download().unwrap() == want);
    let mut surfaces = Surfaces::new(&gpu).unwrap();
    renderer.render_with_surfaces(&scene, &camera, &whole, &mut surfaces).unwrap();
    assert!(renderer.download().unwrap() == want);
    assert_silent(&gpu);
}

/// Frames that the host does not wait for are the same; one that does not fit says so.
#[test]
fn frames_in_flight_have_layers() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = wall(200);
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = renderer.upload(&scene).unwrap();
    renderer.render(&scene, &camera, &RenderOptions::default()).unwrap();
    let want = renderer.download().unwrap();
    let options = RenderOptions { occlusion: true, ..RenderOptions::default() };
    let waited = renderer.render(&scene, &camera, &options).unwrap();
    let mut ahead = Ahead::new(&gpu).unwrap();
    for _ in 0..2 {
        renderer.submit_ahead(&mut ahead, &scene, &camera, &options, ExtraPasses::default()).unwrap();
    }
    for _ in 0..2 {
        let Some(Arrived::Complete(stats)) = ahead.arrive().unwrap() else { panic!("the frame fits") };
        assert!(stats.is_one_submission());
        assert_eq!((stats.layers, stats.work_items), (LAYERS, waited.work_items));
        assert_eq!((stats.visible, stats.intersections), (waited.visible, waited.intersections));
    }
    assert!(renderer.download().unwrap() == want);
    // Too small for the first layers, and large enough for the last, of which nothing is drawn.
    let mut small = Renderer::new(&gpu).unwrap();
    small.set_capacities(Capacities { candidates: u32::MAX, work_items: 8, intersections: 1 << 20 });
    let mut ahead = Ahead::new(&gpu).unwrap();
    small.submit_ahead(&mut ahead, &scene, &camera, &options, ExtraPasses::default()).unwrap();
    assert_eq!(ahead.arrive().unwrap(), Some(Arrived::Incomplete));
    assert_silent(&gpu);
}

/// Buffers that have to grow between layers, and slabs within layers.
#[test]
fn small_buffers_change_nothing() {
    let Some(gpu) = gpu() else { return };
    let (scene, camera) = wall(60);
    let mut renderer = Renderer::new(&gpu).unwrap();
    let options = RenderOptions { occlusion: true, ..RenderOptions::default() };
    let scene = renderer.upload(&scene).unwrap();
    renderer.render(&scene, &camera, &RenderOptions::default()).unwrap();
    let want = renderer.download().unwrap();
    let mut small = Renderer::new(&gpu).unwrap();
    small.set_capacities(Capacities { candidates: 1, work_items: 1, intersections: 1 });
    let stats = small.render(&scene, &camera, &options).unwrap();
    assert!(stats.redone >= 2, "redone {} times", stats.redone);
    assert!(small.download().unwrap() == want);
    let again = small.render(&scene, &camera, &options).unwrap();
    assert_eq!((again.redone, again.slabs), (0, LAYERS), "the second frame fits");
    let few = RenderOptions { max_intersections: Some((again.intersections / 20) as u32), ..options };
    let stats = small.render(&scene, &camera, &few).unwrap();
    assert!(stats.slabs > LAYERS, "{} slabs", stats.slabs);
    assert!(small.download().unwrap() == want);
    assert_silent(&gpu);
}

/// Values that are not finite, or far too large, in one of seven Gaussians.
#[test]
fn poison_is_drawn_as_without_layers() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    for (seed, value) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 88.8].into_iter().enumerate()
    {
        for parameter in 0..4 {
            let mut case = random_case(seed as u64);
            let cloud = &mut case.scene.templates;
            for i in (0..cloud.len()).step_by(7) {
                match parameter {
                    0 => cloud.means[i][i % 3] = value,
                    1 => cloud.quats[i][i % 4] = value,
                    2 => cloud.log_scales[i][i % 3] = value,
                    _ => cloud.opacity_logits[i] = value,
                }
            }
            let whole = device_options(&case.options);
            let scene = renderer.upload(&case.scene).unwrap();
            renderer.render(&scene, &case.camera, &whole).unwrap();
            let want = renderer.download().unwrap();
            renderer.render(&scene, &case.camera, &RenderOptions { occlusion: true, ..whole }).unwrap();
            assert!(renderer.download().unwrap() == want, "seed {seed}, parameter {parameter}");
        }
    }
    assert_silent(&gpu);
}

fn pipelines(gpu: &Arc<Gpu>, tile_size: u32) -> LayerPipelines {
    let cache = PipelineCache::new(gpu, None).unwrap();
    let variant = Variant { tile_size, ..Variant::for_device(gpu.caps()) };
    Pipelines::new(gpu, &cache, variant, SceneTraits::plain(0), Purpose::Layered).unwrap().layers.unwrap()
}

/// Runs what `record` records, and waits for it.
fn run(gpu: &Arc<Gpu>, record: impl FnOnce(&mut Recorder) -> Result<(), GpuError>) {
    let mut recorder = Recorder::new(gpu).unwrap();
    record(&mut recorder).unwrap();
    let ticket = recorder.submit().unwrap();
    recorder.wait(ticket).unwrap();
}

/// Where the layers begin, and the end of the last.
fn bounds_of(counters: &[u32]) -> Vec<u32> {
    counters[COUNTER_LAYER_BEGIN as usize..][..=LAYERS as usize].to_vec()
}

#[test]
fn bounds_are_those_of_the_twin() {
    let Some(gpu) = gpu() else { return };
    let pipelines = pipelines(&gpu, 8);
    let mut rng = Rng::new(3);
    for chunks in [0, 1, 2, 31, 64, 1000, 50_000] {
        for spread in [0.0, 0.1, 3.0, 40.0] {
            let depths: Vec<f32> = (0..chunks).map(|_| (1.0 + spread * rng.normal()).exp() as f32 - 0.5).collect();
            let bins = twin::layer_bins(&depths);
            let layer_bins = upload(&gpu, "layer_bins", &bins).unwrap();
            let mut counters = Buffer::new(&gpu, "counters", COUNTER_COUNT as usize).unwrap();
            let bindings = plan_layers::Bindings { layer_bins: &layer_bins, counters: &mut counters };
            run(&gpu, |recorder| recorder.dispatch(&pipelines.plan_layers, Grid::groups(1), &(), bindings));
            let got = bounds_of(&download(&gpu, &counters, COUNTER_COUNT as usize).unwrap());
            assert_eq!(got, twin::layer_bounds(&bins), "{chunks} chunks, spread {spread}");
            assert!(got.is_sorted());
        }
    }
    assert_silent(&gpu);
}

#[test]
fn the_log_is_that_of_the_twin() {
    let Some(gpu) = gpu() else { return };
    let pipelines = pipelines(&gpu, 8);
    let mut rng = Rng::new(8);
    let mut incomplete = 0;
    for case in 0..40 {
        let mut counters: Vec<u32> = (0..COUNTER_COUNT).map(|_| rng.index(5) as u32).collect();
        (counters[COUNTER_LAYER as usize], counters[COUNTER_INCOMPLETE as usize]) = (case % (LAYERS - 1), case / 30);
        let capacities = [3 + rng.index(3) as u32, 3 + rng.index(3) as u32];
        let mut on_device = upload(&gpu, "counters", &counters).unwrap();
        let bindings = next_layer::Bindings { counters: &mut on_device };
        run(&gpu, |recorder| {
            recorder.dispatch(&pipelines.next_layer, Grid::groups(1), &next_layer::Params { capacities }, bindings)
        });
        let want = twin::next_layer(counters, capacities);
        assert_eq!(download(&gpu, &on_device, COUNTER_COUNT as usize).unwrap(), want, "case {case}");
        incomplete += want[COUNTER_INCOMPLETE as usize];
    }
    assert!((15..40).contains(&incomplete), "{incomplete} incomplete");
    assert_silent(&gpu);
}

/// The bins of a frame hold each chunk that a whole frame expands, at its depth.
#[test]
fn every_visible_chunk_is_counted() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    for seed in 0..30 {
        let case = random_case(seed);
        let whole = device_options(&case.options);
        let scene = renderer.upload(&case.scene).unwrap();
        let chunks = renderer.render(&scene, &case.camera, &whole).unwrap().work_items;
        renderer.render(&scene, &case.camera, &RenderOptions { occlusion: true, ..whole }).unwrap();
        let frame = renderer.frame().unwrap();
        let bins = download(&gpu, &frame.layer_bins, LAYER_BINS as usize).unwrap();
        assert_eq!(bins.iter().map(|&n| u64::from(n)).sum::<u64>(), chunks, "seed {seed}");
        let bounds = bounds_of(&read_counters(frame));
        assert_eq!(bounds, twin::layer_bounds(&bins), "seed {seed}");
    }
    assert_silent(&gpu);
}

#[test]
fn closed_tiles_are_those_of_the_twin() {
    let Some(gpu) = gpu() else { return };
    let mut rng = Rng::new(4);
    for tile_size in [8, 16] {
        let pipelines = pipelines(&gpu, tile_size);
        for size_px in [[1, 1], [8, 8], [93, 61], [1030, 9], [17, 300]] {
            let tiles = size_px.map(|side: u32| side.div_ceil(tile_size));
            for live_share in [0.0, 0.002, 0.02] {
                let live: Vec<f32> =
                    (0..size_px[0] * size_px[1]).map(|_| if rng.chance(live_share) { 1e-4 } else { 0.0 }).collect();
                let depths: Vec<[f32; 2]> = live.iter().map(|&t| [5.0, t]).collect();
                let depths = upload(&gpu, "depths", &depths).unwrap();
                let count = (tiles[0] * tiles[1]) as usize;
                let mut closed_runs = upload(&gpu, "closed_runs", &vec![77u32; count]).unwrap();
                let bindings = close_tiles::Bindings { depths: &depths, closed_runs: &mut closed_runs };
                let params = close_tiles::Params { size_px, tiles };
                run(&gpu, |recorder| {
                    recorder.dispatch(&pipelines.close_tiles, Grid::groups(tiles[1]), &params, bindings)
                });
                let got = download(&gpu, &closed_runs, count).unwrap();
                assert!(got == twin::closed_runs(&live, size_px, tile_size), "{size_px:?}, {live_share}");
            }
        }
    }
    assert_silent(&gpu);
}
