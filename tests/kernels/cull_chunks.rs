//! Culling never loses a chunk that shows, and does drop what is far outside.

use std::collections::BTreeSet;

use glam::DVec3;

use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::staging::download;
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::reference::compact::compact;
use instgs_vk::reference::cull_chunks::{CHUNK_SIZE, visible_chunks};
use instgs_vk::render::forward::read_counters;
use instgs_vk::render::{RenderOptions, Renderer};
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

use crate::common::gpu::{assert_silent, device_options, gpu, render_picture};
use crate::common::random_scene::random_case;

#[test]
fn every_chunk_that_shows_survives() {
    let Some(gpu) = gpu() else { return };
    let variant = Variant::for_device(gpu.caps());
    let mut renderer = Renderer::new(&gpu).unwrap();
    let (mut kept, mut pairs) = (0, 0);
    for seed in 0..100 {
        let case = random_case(seed);
        let scene = renderer.upload(&case.scene).unwrap();
        renderer.render(&scene, &case.camera, &device_options(&case.options)).unwrap();
        let frame = renderer.frame().unwrap();
        let counters = read_counters(frame);
        let work_items = counters[COUNTER_WORK_ITEMS as usize] as usize;
        let candidates = counters[COUNTER_CANDIDATES as usize] as usize;
        let flags = download(&gpu, &frame.candidate_visible, candidates).unwrap();
        let listed = download(&gpu, &frame.candidates, candidates).unwrap();
        let want: Vec<_> =
            compact(&flags.iter().map(|&f| f != 0).collect::<Vec<_>>()).iter().map(|&c| listed[c as usize]).collect();
        let items = download(&gpu, &frame.work_items, work_items).unwrap();
        assert!(items == want, "seed {seed}: the work list is the compacted candidates");
        let got: Vec<(u32, u32)> = items.iter().map(|w| (w.instance, w.chunk)).collect();
        assert!(got.is_sorted(), "seed {seed}: work items are in flat order");
        // The twin's chunks are of CHUNK_SIZE Gaussians; the device's of its work-group size.
        let per_chunk = CHUNK_SIZE / variant.workgroup_size;
        let got: BTreeSet<(u32, u32)> = got.into_iter().map(|(i, c)| (i, c / per_chunk)).collect();
        for item in visible_chunks(&case.scene, &case.camera, &case.options) {
            assert!(got.contains(&(item.instance, item.chunk)), "seed {seed}: {item:?} was culled");
        }
        kept += work_items as u64;
        pairs += scene.chunk_pairs;
    }
    println!("culling kept {kept} of {pairs} chunks");
    // The cameras look at one instance of several: a test that keeps nearly everything culls nothing.
    assert!(kept * 100 < pairs * 95, "kept {kept} of {pairs} chunks");
    assert_silent(&gpu);
}

/// Far from the origin, and with transforms that are rigid only within what validation allows, culling keeps whatever
/// shows: the picture is that of the same splats in one chunk with a splat that is never culled.
#[test]
fn large_coordinates_and_sloppy_poses_lose_nothing() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let options = RenderOptions::default();
    for (origin, stretch, radius, distance) in
        [(3e6, 1.0, 0.3, 5.0), (0.0, 1.0004, 1000.0, 10.0), (0.0, 1.0004, 100.0, 3.0)]
    {
        let mut rng = Rng::new(4);
        let center = DVec3::new(origin, -origin, origin);
        let mut cloud = ball(&mut rng, center, radius);
        let mut differing = 0;
        for _ in 0..20 {
            // Cameras that see the ball's edge at the border of the image.
            let eye = center + rng.unit_vector() * (radius + distance);
            let target = center + rng.unit_vector() * (radius * 2.0);
            let mut camera = Camera::look_at("far", eye, target, rng.unit_vector(), 0.7, (64, 48));
            camera.view_from_world[..3].iter_mut().flatten().for_each(|v| *v *= stretch);
            let alone = render_picture(&mut renderer, &InstancedScene::from_cloud(cloud.clone()), &camera, &options);
            // A splat right in front of the camera, too faint to draw, makes the chunk's ball reach the image.
            let before = cloud.len();
            cloud.means.push((eye + (target - eye).normalize() * 2.0).as_vec3().to_array());
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([(2.0 * radius as f32).ln(); 3]);
            cloud.opacity_logits.push(-12.0);
            cloud.sh.push([0.0; 3]);
            let kept = render_picture(&mut renderer, &InstancedScene::from_cloud(cloud.clone()), &camera, &options);
            cloud = cloud.filtered(|i| i < before);
            differing += usize::from(alone != kept);
        }
        assert_eq!(differing, 0, "origin {origin}, stretch {stretch}");
    }
    assert_silent(&gpu);
}

/// Small bright splats on a sphere, fewer than a chunk.
fn ball(rng: &mut Rng, center: DVec3, radius: f64) -> Gaussians {
    let mut cloud = Gaussians::with_capacity(0, 101);
    for _ in 0..100 {
        cloud.means.push((center + radius * rng.unit_vector()).as_vec3().to_array());
        cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
        cloud.log_scales.push([(0.01 * radius as f32).ln(); 3]);
        cloud.opacity_logits.push(4.0);
        cloud.sh.push([1.0; 3]);
    }
    cloud
}
