//! Writes the scale test of the forward pass: a 50,000-Gaussian template with 10,000 instances of which a camera sees
//! about 20 (`many.instgs`), a scene of only the instances it sees (`few.instgs`), the camera, and the same with offsets on
//! 100 instances (`offsets.instgs`).
//!
//!     cargo run --release --example scale_scene -- out/scale
//!     instgs-vk bench --scene out/scale/many.instgs --against out/scale/few.instgs --camera out/scale/camera.json

use std::path::PathBuf;

use glam::{DMat3, DVec3};
use instgs_vk::io::camera_file::write_cameras;
use instgs_vk::io::save_scene;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::reference::preprocess_instance_expand::sources;
use instgs_vk::scene::{Camera, Gaussians, Instance, InstancedScene, Offsets, TemplateRange};

const TEMPLATE_LEN: usize = 50_000;
const SIDE: usize = 100;
const SPACING: f64 = 3.0;

/// A ball of small discs: SH degree 3, radius 1.
fn template() -> Gaussians {
    let mut rng = Rng::new(1);
    let mut cloud = Gaussians::with_capacity(3, TEMPLATE_LEN);
    for _ in 0..TEMPLATE_LEN {
        let normal = rng.unit_vector();
        cloud.means.push(normal.as_vec3().to_array());
        cloud.quats.push(rng.rotation_quat().map(|q| q as f32));
        cloud.log_scales.push([-5.0, -4.6, -4.3]);
        cloud.opacity_logits.push(rng.range(0.0, 3.0) as f32);
        for c in 0..16 {
            let amplitude = if c == 0 { 1.0 } else { 0.1 };
            cloud.sh.push([0; 3].map(|_| (amplitude * rng.normal()) as f32));
        }
    }
    cloud
}

fn grid_instances() -> Vec<Instance> {
    let place = |k: usize| {
        let center = DVec3::new((k % SIDE) as f64 * SPACING, 0.0, (k / SIDE) as f64 * SPACING);
        let turn = DMat3::from_rotation_y(k as f64 * 0.7);
        Instance {
            template: 0,
            world_from_template: Similarity::from_parts(turn, 0.8 + 0.4 * (k % 7) as f64 / 6.0, center),
            first_offset: None,
        }
    };
    (0..SIDE * SIDE).map(place).collect()
}

/// Straight down onto the middle of the field, high enough to see five by four instances.
fn camera() -> Camera {
    let middle = (SIDE as f64 / 2.0) * SPACING;
    let target = DVec3::new(middle, 0.0, middle);
    Camera::look_at("down", target + DVec3::new(0.0, 10.0, 0.0), target, DVec3::Z, 0.9, (800, 640))
}

/// The instances of which the camera sees at least one Gaussian's centre, or nearly.
fn visible_instances(scene: &InstancedScene, camera: &Camera) -> Vec<usize> {
    let (rotation, translation) = (camera.rotation(), camera.translation());
    let seen = |instance: &Instance| {
        let c = rotation * instance.world_from_template.translation() + translation;
        let radius = 1.05 * instance.world_from_template.scale();
        let reach = |v: f64, f: f64, half: f64| (f * v).abs() - half * c.z <= radius * (f + half);
        c.z > 0.0
            && reach(c.x, camera.fx, 0.5 * f64::from(camera.width))
            && reach(c.y, camera.fy, 0.5 * f64::from(camera.height))
    };
    (0..scene.instances.len()).filter(|&k| seen(&scene.instances[k])).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let out = PathBuf::from(std::env::args().nth(1).ok_or("usage: scale_scene OUT")?);
    std::fs::create_dir_all(&out)?;
    let mut many = InstancedScene {
        templates: template(),
        template_ranges: vec![TemplateRange { first: 0, count: TEMPLATE_LEN as u32 }],
        instances: grid_instances(),
        ..Default::default()
    };
    let camera = camera();
    let visible = visible_instances(&many, &camera);
    let few = InstancedScene {
        instances: visible.iter().map(|&k| many.instances[k].clone()).collect(),
        ..many.clone()
    };
    assert_eq!(sources(&few).len(), visible.len() * TEMPLATE_LEN);
    save_scene(&out.join("many.instgs"), &many)?;
    save_scene(&out.join("few.instgs"), &few)?;
    write_cameras(&out.join("camera.json"), &[camera])?;
    let with_offsets = 100 * TEMPLATE_LEN;
    for (i, k) in (0..100).enumerate() {
        many.instances[k * 97].first_offset = Some((i * TEMPLATE_LEN) as u32);
    }
    many.offsets = Offsets {
        means: vec![[0.001, 0.0, 0.0]; with_offsets],
        sh_dc: vec![[0.1, 0.0, 0.0]; with_offsets],
        opacity_logits: vec![0.1; with_offsets],
    };
    save_scene(&out.join("offsets.instgs"), &many)?;
    #[allow(clippy::print_stdout, reason = "an example talks to its user")]
    {
        println!("{} of {} instances are in view", visible.len(), SIDE * SIDE);
    }
    Ok(())
}
