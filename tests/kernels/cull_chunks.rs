//! Culling never loses a chunk that shows, and does drop what is far outside.

use std::collections::BTreeSet;

use glam::DVec3;

use instgs_reference::compact::compact;
use instgs_reference::cull_chunks::{CHUNK_SIZE, visible_chunks};
use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::staging::download;
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::render::forward::read_counters;
use instgs_vk::render::{RenderOptions, Renderer};
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

use crate::common::gpu::{assert_silent, device_options, gpu, render_picture};
use crate::common::random_scene::{RandomCase, random_case, rare_case};

/// With offsets that make Gaussians up to twenty times as large, which chunk bounds of templates know nothing of.
fn enlarged(mut case: RandomCase) -> RandomCase {
    let offsets = &mut case.scene.offsets.log_scales;
    offsets.iter_mut().enumerate().for_each(|(i, offset)| offset[i % 3] += (i % 7) as f32 / 2.0);
    case
}

#[test]
fn every_chunk_that_shows_survives() {
    let Some(gpu) = gpu() else { return };
    let variant = Variant::for_device(gpu.caps());
    let mut renderer = Renderer::new(&gpu).unwrap();
    let (mut kept, mut pairs) = (0, 0);
    let enlarged = (0..40).map(|seed| enlarged(rare_case(seed)));
    for case in (0..100).map(random_case).chain(enlarged) {
        let seed = case.seed;
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
            assert!(got.contains(&(item.row, item.chunk)), "seed {seed}: {item:?} was culled");
        }
        kept += work_items as u64;
        pairs += scene.chunk_pairs;
    }
    println!("culling kept {kept} of {pairs} chunks");
    // The cameras look at one instance of several: a test that keeps nearly everything culls nothing.
    assert!(kept * 100 < pairs * 95, "kept {kept} of {pairs} chunks");
    assert_silent(&gpu);
}

/// How many of the cameras see something else when a splat too faint to draw, right in front of the camera, keeps the
/// cloud's only chunk from being culled.
fn pictures_changed_by_culling(cloud: &Gaussians, cameras: &[Camera]) -> usize {
    let Some(gpu) = gpu() else { return 0 };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let options = RenderOptions::default();
    let changed = |camera: &&Camera| {
        let culled = render_picture(&mut renderer, &InstancedScene::from_cloud(cloud.clone()), camera, &options);
        let mut kept = cloud.clone();
        let ahead = camera.position_world() + camera.rotation().transpose() * DVec3::Z;
        push_splat(&mut kept, ahead, 1e4, -12.0);
        culled != render_picture(&mut renderer, &InstancedScene::from_cloud(kept), camera, &options)
    };
    let count = cameras.iter().filter(changed).count();
    assert_silent(&gpu);
    count
}

fn push_splat(cloud: &mut Gaussians, mean: DVec3, sigma: f32, opacity_logit: f32) {
    cloud.means.push(mean.as_vec3().to_array());
    cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
    cloud.log_scales.push([sigma.ln(); 3]);
    cloud.opacity_logits.push(opacity_logit);
    cloud.sh.push([1.0; 3]);
}

/// At coordinates of millions, as in geographic scenes, the view transform rounds to half a unit. With slack for the view
/// coordinates alone, as it once was, 2 to 7 of 300 such cameras differ.
#[test]
fn large_coordinates_lose_nothing() {
    let center = DVec3::new(2e6, -4e6, 3e6);
    let mut rng = Rng::new(4);
    let mut cloud = Gaussians::with_capacity(0, 101);
    (0..100).for_each(|_| push_splat(&mut cloud, center + 0.3 * rng.unit_vector(), 0.003, 4.0));
    let cameras: Vec<Camera> = (0..300)
        .map(|_| {
            // The ball of splats is at the border of the image: half of 32 px off the axis, at depth 5.
            let (forward, other) = (rng.unit_vector(), rng.unit_vector());
            let side = forward.cross(other).normalize();
            let eye = center - 5.0 * forward + rng.range(-0.5, 0.5) * side;
            let mut camera = Camera::look_at("far", eye, eye + forward, other, 1.0, (32, 24));
            (camera.fx, camera.fy) = (1000.0, 1000.0);
            camera
        })
        .collect();
    assert_eq!(pictures_changed_by_culling(&cloud, &cameras), 0);
}

/// Poses are accepted when they are rigid within 1e-3; one that stretches by 4e-4 moves the edge of a large chunk by as much.
#[test]
fn poses_that_are_nearly_rigid_lose_nothing() {
    let camera = Camera {
        name: "stretched".into(),
        width: 64,
        height: 48,
        fx: 100.0,
        fy: 100.0,
        cx: 32.0,
        cy: 24.0,
        view_from_world: [
            [1.0004, 0.0, 0.0, 0.0],
            [0.0, 1.0004, 0.0, 0.0],
            [0.0, 0.0, 1.0004, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
    };
    // One splat just inside the left border, the other 20,000 units away along the outward normal of the plane
    // that culling tests: the left border (32 px) plus what dilation adds (2.83 px).
    let seen = DVec3::new(-0.32 * 10.0 + 0.05, 0.0, 10.0);
    let outward = DVec3::new(-100.0, 0.0, -34.83).normalize();
    let mut cloud = Gaussians::with_capacity(0, 3);
    push_splat(&mut cloud, seen, 0.001, 4.0);
    push_splat(&mut cloud, seen + 20_000.0 * outward, 0.001, 4.0);
    assert_eq!(pictures_changed_by_culling(&cloud, &[camera]), 0);
}
