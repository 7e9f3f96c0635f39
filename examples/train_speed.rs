//! Scratch: training speed on a dataset folder: `train_speed DATA WIDTH STEPS`.
#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "an example")]
use std::path::Path;
use std::time::Instant;
use instgs_vk::gpu::staging::upload;
use instgs_vk::gpu::{Gpu, GpuOptions};
use instgs_vk::io::dataset::{Split, read_views};
use instgs_vk::io::view_image::load_view;
use instgs_vk::kernels::Variant;
use instgs_vk::optim::Adam;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::InstancedScene;
use instgs_vk::train::config::ConfigBuilder;
use instgs_vk::train::device_state::DeviceState;
use instgs_vk::train::initial::{from_points, scene_extent};
use instgs_vk::train::step_runner::{DeviceView, StepPlan, StepRunner};
use instgs_vk::train::view_order::ViewOrder;

fn main() {
    // SAFETY: one thread so far.
    unsafe { instgs_vk::cli::choose_lavapipe_width() };
    let args: Vec<String> = std::env::args().collect();
    let (data, width, steps) = (Path::new(&args[1]), args[2].parse::<u32>().unwrap(), args[3].parse::<u64>().unwrap());
    let mut builder = ConfigBuilder::new().file("quick").unwrap();
    builder = builder.set(&format!("steps={steps}")).unwrap();
    for set in &args[4..] { builder = builder.set(set).unwrap(); }
    let config = builder.finish().unwrap();
    let dataset = read_views(data).unwrap();
    let gpu = Gpu::open(&GpuOptions::default()).unwrap();
    let load = |split| -> Vec<_> { dataset.split(split).map(|v| load_view(v, Some(width)).unwrap()).collect() };
    let (train, test) = (load(Split::Train), load(Split::Test));
    let views: Vec<DeviceView> = train.iter().map(|v| DeviceView { camera: v.camera.clone(), targets: upload(&gpu, "t", &v.image.rgba.iter().map(|p| u32::from_le_bytes(*p)).collect::<Vec<_>>()).unwrap() }).collect();
    let points = instgs_vk::io::point_cloud::read_points(data).unwrap().unwrap().points;
    let cameras: Vec<_> = train.iter().map(|v| v.camera.clone()).collect();
    let extent = scene_extent(&cameras, &points);
    let scene = InstancedScene::from_cloud(from_points(&points, config.sh_degree));
    let mut variant = Variant::for_device(gpu.caps());
    if std::env::var("BUTTERFLY").is_ok() { variant.transpose_moments = false; }
    let largest = [train.iter().map(|v| v.camera.width).max().unwrap(), train.iter().map(|v| v.camera.height).max().unwrap()];
    let mut runner = StepRunner::new(&gpu, variant, largest, true).unwrap();
    let mut state = DeviceState::new(&gpu, &scene, runner.chunk_size()).unwrap();
    println!("{} views {largest:?}, {} Gaussians, extent {extent:.3}", views.len(), scene.background.len());
    let mut order = ViewOrder::new(0, views.len());
    let start = Instant::now();
    let mut last = None;
    for step in 0..steps {
        let plan = StepPlan {
            step, view: order.view_at(step).unwrap(), options: RenderOptions::default(), rates: config.rates_at(step, extent),
            sh_degree: config.sh_degree_at(step), lambda_dssim: config.lambda_dssim as f32,
            adam: Adam { beta1: config.rates.beta1, beta2: config.rates.beta2, epsilon: config.rates.eps, step: step + 1 },
            mcmc: instgs_vk::train::strategy::McmcStep::new(&config, &config.rates_at(step, extent)),
        };
        if let Some(o) = runner.submit(&mut state, &views, plan).unwrap() { if o.step % 50 == 0 { println!("{o:?}"); } last = Some(o); }
    }
    while let Some(o) = runner.collect(&mut state, &views).unwrap() { last = Some(o); }
    let seconds = start.elapsed().as_secs_f64();
    println!("{last:?}\n{:.2} steps/s, grown {:?}", steps as f64 / seconds, runner.take_grown());
    let times = runner.take_times();
    println!("waiting {:.2} of {seconds:.2} s", times.waiting.as_secs_f64());
    let mut passes: Vec<_> = times.passes_ms.into_iter().map(|(n, ms)| (ms / times.steps as f64, n)).collect();
    passes.sort_by(|a, b| b.0.total_cmp(&a.0));
    let total: f64 = passes.iter().map(|p| p.0).sum();
    for (ms, name) in passes { println!("{ms:8.3} ms  {name}"); }
    println!("{total:8.3} ms  sum");
    let trained = state.scene.download(&gpu, &scene).unwrap();
    instgs_vk::io::write_ply(Path::new("/tmp/trained.ply"), &trained.background).unwrap();
    let mut renderer = instgs_vk::render::Renderer::new(&gpu).unwrap();
    let device_scene = renderer.upload(&trained).unwrap();
    let mut sum = 0.0;
    for v in &test {
        renderer.render(&device_scene, &v.camera, &RenderOptions::default()).unwrap();
        let picture = renderer.download().unwrap();
        let mut mse = 0.0;
        for (p, t) in picture.colors.iter().zip(&v.image.rgba) { for c in 0..3 { let d = f64::from(p[c].clamp(0.0, 1.0)) - f64::from(t[c]) / 255.0; mse += d * d; } }
        let psnr = -10.0 * (mse / (3 * v.image.rgba.len()) as f64).log10();
        sum += psnr;
        print!("{psnr:.2} ");
    }
    println!("\ntest PSNR {:.3}", sum / test.len() as f64);
}
