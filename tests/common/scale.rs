//! The scale test of the forward pass: far more expanded Gaussians than memory could hold, of which a camera sees few.

use glam::{DMat3, DVec3};

use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Camera, Gaussians, Instance, InstancedScene, Offsets, SourceRange};

/// Instances per side of the square field; neighbours stand `SPACING` apart.
const SIDE: usize = 100;
/// World units between neighbours; instances have radius 0.8 to 1.2.
const SPACING: f64 = 3.0;

/// `SIDE`^2 = 10,000 instances of one template of `template_len` Gaussians.
pub(crate) fn field(template_len: usize) -> InstancedScene {
    InstancedScene {
        templates: template(template_len),
        template_ranges: vec![SourceRange { first: 0, count: template_len as u32 }],
        instances: grid_instances(),
        source: "scale test".into(),
        ..InstancedScene::default()
    }
}

/// The field with only the instances that the camera may see.
pub(crate) fn seen_part(field: &InstancedScene, camera: &Camera) -> InstancedScene {
    let instances = visible_instances(field, camera).into_iter().map(|k| field.instances[k].clone()).collect();
    InstancedScene { instances, ..field.clone() }
}

/// The field with offsets on `count` of its instances, at most 100.
pub(crate) fn with_offsets(field: &InstancedScene, count: usize) -> InstancedScene {
    let per_instance = field.templates.len();
    let mut out = field.clone();
    for i in 0..count.min(100) {
        out.instances[97 * i].first_offset = Some((i * per_instance) as u32);
    }
    let records = count * per_instance;
    out.offsets = Offsets {
        means: vec![[0.001, 0.0, 0.0]; records],
        sh_dc: vec![[0.1, 0.0, 0.0]; records],
        opacity_logits: vec![0.1; records],
        ..Offsets::default()
    };
    out
}

/// Straight down onto the middle of the field, at a height from which about 20 instances are in view.
pub(crate) fn camera(size_px: (u32, u32)) -> Camera {
    let middle = (SIDE as f64 / 2.0) * SPACING;
    let target = DVec3::new(middle, 0.0, middle);
    Camera::look_at("down", target + DVec3::new(0.0, 10.0, 0.0), target, DVec3::Z, 0.9, size_px)
}

/// The first thousand of the field's instances: ten rows.
pub(crate) fn thousand(field: &InstancedScene) -> InstancedScene {
    InstancedScene { instances: field.instances[..10 * SIDE].to_vec(), ..field.clone() }
}

/// Straight down along the middle of [`thousand`], from a height at which about 10 instances are in view of a wide picture.
pub(crate) fn flight(count: u32, size_px: (u32, u32)) -> Vec<Camera> {
    let camera = |i: u32| {
        let along = 0.2 + 0.6 * f64::from(i) / f64::from(count.max(2) - 1);
        let target = DVec3::new(along * SIDE as f64 * SPACING, 0.0, 5.0 * SPACING);
        Camera::look_at(&format!("flight_{i:03}"), target + DVec3::new(0.0, 7.0, 0.0), target, DVec3::Z, 0.9, size_px)
    };
    (0..count).map(camera).collect()
}

/// A ball of small discs: SH degree 3, radius 1.
fn template(len: usize) -> Gaussians {
    let mut rng = Rng::new(1);
    let mut cloud = Gaussians::with_capacity(3, len);
    for _ in 0..len {
        cloud.means.push(rng.unit_vector().as_vec3().to_array());
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
