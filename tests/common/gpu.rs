//! The device of the GPU tests: validation and synchronization validation on, any message is a failure.

use std::sync::{Arc, OnceLock};

use instgs_vk::gpu::{DeviceChoice, Gpu, GpuOptions};
use instgs_vk::kernels::{Variant, open_tuned};
use instgs_vk::render::{Picture, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, InstancedScene};

/// The device shared by all tests of a binary; `INSTGS_TEST_DEVICE` chooses another than the best. Without a device the
/// tests fail, unless `INSTGS_SKIP_GPU=1` is set aloud: then `None`.
pub(crate) fn gpu() -> Option<Arc<Gpu>> {
    static GPU: OnceLock<Option<Arc<Gpu>>> = OnceLock::new();
    GPU.get_or_init(|| {
        let device = std::env::var("INSTGS_TEST_DEVICE").map_or(DeviceChoice::Best, |name| name.parse().unwrap());
        match open_tuned(GpuOptions { device, validation: true, ..Default::default() }) {
            Ok(gpu) => Some(gpu),
            Err(error) if std::env::var("INSTGS_SKIP_GPU").as_deref() == Ok("1") => {
                #[allow(clippy::print_stderr, reason = "a skipped check must be heard")]
                {
                    eprintln!("GPU TESTS SKIPPED (INSTGS_SKIP_GPU=1): {error}");
                }
                None
            }
            Err(error) => panic!("{error} (set INSTGS_SKIP_GPU=1 to skip GPU tests)"),
        }
    })
    .clone()
}

/// The device of the tests with chunks of at most 32 Gaussians, or as many as a subgroup has lanes: the small bindings that are
/// tested hold several of these, but none of the 256 that GPUs get.
pub(crate) fn gpu_with_small_chunks() -> Option<Arc<Gpu>> {
    const MOST: u32 = 32;
    static GPU: OnceLock<Option<Arc<Gpu>>> = OnceLock::new();
    GPU.get_or_init(|| {
        let gpu = gpu()?;
        let picked = Variant::for_device(gpu.caps());
        let size = MOST.max(picked.subgroup_size);
        if picked.workgroup_size <= size {
            return Some(gpu);
        }
        // A later number replaces an earlier one of the same name.
        let others = gpu.caps().tuning.numbers().map(|(name, number)| format!("{name}={number},"));
        let tuning = others.collect::<String>() + &format!("workgroup_size={size}");
        Some(opened_again(&gpu, GpuOptions { tuning: tuning.parse().unwrap(), ..Default::default() }))
    })
    .clone()
}

/// A device of the tests as if a binding had at most `bytes` bytes.
pub(crate) fn with_bindings_of(gpu: &Gpu, bytes: u64) -> Arc<Gpu> {
    let tuning = gpu.caps().tuning.clone();
    opened_again(gpu, GpuOptions { most_binding_bytes: Some(bytes), tuning, ..Default::default() })
}

/// The same device with other options, and with validation.
fn opened_again(gpu: &Gpu, options: GpuOptions) -> Arc<Gpu> {
    let device = DeviceChoice::Name(gpu.caps().name.clone());
    Gpu::open(&GpuOptions { device, validation: true, ..options }).unwrap()
}

/// Fails on any message of the validation layers so far.
pub(crate) fn assert_silent(gpu: &Gpu) {
    let messages = gpu.validation_messages().take();
    assert!(messages.is_empty(), "validation messages:\n{}", messages.join("\n"));
}

/// How far sin and cos of the device may be off: hardly at all on lavapipe, whose functions are as good as the host's, and
/// elsewhere as far as Vulkan allows (2^-11; what it allows for log and exp is less).
pub(crate) fn trigonometric_error(gpu: &Gpu) -> f64 {
    if gpu.caps().is_llvmpipe { 0.0 } else { 1.0 / 2048.0 }
}

/// The smallest number that a device may not take for 0, and a little more.
pub(crate) const SMALLEST_NORMAL: f32 = 2e-38;

/// Renderer options that mean the same as the twin's.
pub(crate) fn device_options(options: &instgs_reference::RenderOptions) -> RenderOptions {
    RenderOptions {
        near: options.near as f32,
        dilation_px2: options.dilation as f32,
        antialias: options.antialias,
        background: options.background.map(|v| v as f32),
        ..RenderOptions::default()
    }
}

/// Uploads, renders and downloads.
pub(crate) fn render_picture(
    renderer: &mut Renderer,
    scene: &InstancedScene,
    camera: &Camera,
    options: &RenderOptions,
) -> Picture {
    let device_scene = renderer.upload(scene).unwrap();
    renderer.render(&device_scene, camera, options).unwrap();
    renderer.download().unwrap()
}

/// rgb of a picture in f64.
pub(crate) fn rgb(picture: &Picture) -> Vec<[f64; 3]> {
    picture.colors.iter().map(|c| [c[0], c[1], c[2]].map(f64::from)).collect()
}

/// Alpha of a picture in f64.
pub(crate) fn alpha(picture: &Picture) -> Vec<[f64; 1]> {
    picture.colors.iter().map(|c| [f64::from(c[3])]).collect()
}

/// Depth of a picture in f64.
pub(crate) fn depth(picture: &Picture) -> Vec<[f64; 1]> {
    picture.depths.iter().map(|&d| [f64::from(d)]).collect()
}
