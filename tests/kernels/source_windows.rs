//! Scenes whose arrays are larger than a binding: pictures have the same bytes as where all of it can be bound at once.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use instgs_vk::gpu::{DeviceChoice, Gpu, GpuOptions};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{RenderOptions, Renderer};
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Camera, DevicePrecision, Gaussians, Instance, InstancedScene, Offsets, SourceRange};

use crate::common::gpu::{assert_silent, gpu};

/// The device of the tests as if a binding had at most `bytes` bytes.
fn with_bindings_of(gpu: &Gpu, bytes: u64) -> Arc<Gpu> {
    let device = DeviceChoice::Name(gpu.caps().name.clone());
    let options = GpuOptions { device, validation: true, most_binding_bytes: Some(bytes), ..Default::default() };
    Gpu::open(&options).unwrap()
}

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
    let Some(gpu) = gpu() else { return };
    let small = with_bindings_of(&gpu, 2 << 20);
    let camera = Camera::look_at("ahead", DVec3::new(0.3, -0.2, -3.0), DVec3::ZERO, DVec3::NEG_Y, 0.8, (72, 56));
    let (mut whole, mut windowed) = (Renderer::new(&gpu).unwrap(), Renderer::new(&small).unwrap());
    for (seed, degrees, counts) in [(1, [3, 3], [9000, 3000]), (2, [2, 3], [40, 700]), (3, [3, 0], [20_000, 15_000])] {
        let scene = scene(seed, degrees, counts);
        for (precision, lod_error_px) in
            DevicePrecision::ALL.map(|p| (p, 0.0)).into_iter().chain([(DevicePrecision::F16, 2.0)])
        {
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
        // What the windows show is the scene: without its last Gaussians the picture is another.
        let mut less = scene.clone();
        less.background.opacity_logits[45_000..].fill(-20.0);
        let on_device = windowed.upload_for(&less, &RenderOptions::default()).unwrap();
        windowed.render(&on_device, &camera, &RenderOptions::default()).unwrap();
        assert!(windowed.download().unwrap() != whole.download().unwrap());
    }
    assert_silent(&gpu);
    assert_silent(&small);
}
