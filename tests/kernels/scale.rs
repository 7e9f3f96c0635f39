//! A template of 50,000 Gaussians times 10,000 instances: memory and work follow what is visible, not what there is.

use instgs_vk::render::{RenderOptions, Renderer};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::scale;

/// 5 * 10^8 expanded Gaussians take under 64 MB as a scene; offsets on 100 instances add their own 28 bytes a record.
#[test]
fn scene_memory_is_one_template_and_a_table() {
    let Some(gpu) = gpu() else { return };
    let renderer = Renderer::new(&gpu).unwrap();
    let field = scale::field(50_000);
    let plain = renderer.upload(&field).unwrap();
    assert_eq!(plain.expanded_len, 500_000_000);
    println!("scene of {} expanded Gaussians: {} bytes", plain.expanded_len, plain.bytes());
    assert!(plain.bytes() < 64_000_000, "{} bytes", plain.bytes());
    let plain_bytes = plain.bytes();
    drop(plain);
    let with_offsets = renderer.upload(&scale::with_offsets(&field, 100)).unwrap();
    let added = (with_offsets.bytes() - plain_bytes) as f64;
    let records = 100.0 * 50_000.0 * 28.0;
    assert!((added / records - 1.0).abs() < 0.01, "{added} bytes for {records} bytes of offsets");
    assert_silent(&gpu);
}

/// The frame expands the same chunks, sees the same splats and gives the same bytes as a scene that holds only the
/// instances in view.
#[test]
fn unseen_instances_cost_no_work_and_change_no_pixel() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let field = scale::field(5_000);
    let camera = scale::camera((200, 160));
    let few = scale::seen_part(&field, &camera);
    assert!((15..30).contains(&few.instances.len()), "{} instances in view", few.instances.len());
    let options = RenderOptions::default();
    let many_device = renderer.upload(&field).unwrap();
    let many = renderer.render(&many_device, &camera, &options).unwrap();
    let many_picture = renderer.download().unwrap();
    let few_device = renderer.upload(&few).unwrap();
    let few = renderer.render(&few_device, &camera, &options).unwrap();
    assert_eq!((many.work_items, many.visible, many.intersections), (few.work_items, few.visible, few.intersections));
    assert!(many_picture == renderer.download().unwrap());
    assert!(many_picture.colors.iter().any(|c| c[3] > 0.9), "something is in view");
    assert_silent(&gpu);
}
