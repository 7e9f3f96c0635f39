//! Objects whose shape is the same after half a turn, but not their paint.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use instgs_objects::register::{RegisterInput, RegisterOptions, register};
use instgs_vk::math::covariance::quat_from_rotation;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::SH_C0;
use instgs_vk::scene::{Camera, Gaussians};

/// Cabinets of a scene, Gaussians of each.
const CABINETS: u32 = 6;
const GAUSSIANS: usize = 60;

/// Cabinets in a row, each turned about z by its angle, radians; a fifth of each's Gaussians is on its front (x), red if
/// painted.
fn cabinets(seed: u64, is_painted: bool) -> (Gaussians, Vec<u32>, Vec<f64>) {
    let mut rng = Rng::new(seed);
    let half = DVec3::new(0.2, 0.4, 0.6);
    let (mut cloud, mut labels, mut angles) = (Gaussians::with_capacity(0, 0), Vec::new(), Vec::new());
    for id in 1..=CABINETS {
        let angle = rng.range(0.0, TAU);
        angles.push(angle);
        let turn = DMat3::from_rotation_z(angle);
        for i in 0..GAUSSIANS {
            // Front, back, two sides, top.
            let normal = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z][i % 5];
            let within = DVec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
            let on_face = within * (DVec3::ONE - normal.abs()) + normal;
            let side = normal.any_orthonormal_vector();
            let frame = turn * DMat3::from_cols(side, normal.cross(side), normal);
            let mean =
                turn * (on_face * half + 0.005 * rng.normal_vector()) + DVec3::new(2.0 * f64::from(id), 0.0, 0.0);
            let red = is_painted && i % 5 == 0;
            let shade = if red { DVec3::new(0.8, 0.1, 0.1) } else { DVec3::splat(0.5) } + 0.03 * rng.normal_vector();
            cloud.means.push(mean.as_vec3().to_array());
            cloud.quats.push(quat_from_rotation(frame).map(|q| q as f32));
            cloud.log_scales.push([-2.5, -2.5, -4.5]);
            cloud.opacity_logits.push(2.0);
            cloud.sh.push(((shade - 0.5) / SH_C0).as_vec3().to_array());
            labels.push(id);
        }
    }
    (cloud, labels, angles)
}

/// Cabinets that are turned against the first by more than 90 degrees from where they stand.
fn flipped(seed: u64, is_painted: bool) -> usize {
    let (cloud, labels, angles) = cabinets(seed, is_painted);
    let eye = |i: u32| DVec3::new(7.0 + 9.0 * f64::from(i).cos(), 9.0 * f64::from(i).sin(), 5.0);
    let at = |i| Camera::look_at("", eye(i), DVec3::new(7.0, 0.0, 0.0), DVec3::Z, 0.9, (64, 48));
    let cameras: Vec<Camera> = (0..12).map(at).collect();
    let categories: BTreeMap<u32, String> = (1..=CABINETS).map(|id| (id, "cabinet".into())).collect();
    let input =
        RegisterInput { cloud: &cloud, instance_of_gaussian: &labels, categories: &categories, cameras: &cameras };
    let found = register(&input, None, &RegisterOptions::default()).unwrap();
    let [group] = &found.groups[..] else { panic!("{:?}", found.instances) };
    assert_eq!(group.instances.len(), CABINETS as usize);
    let angle = |id: u32| angles[id as usize - 1];
    let reference = group.instances[0].id;
    let is_flipped = |id: u32, rotation: DMat3| {
        let want = DMat3::from_rotation_z(angle(id) - angle(reference));
        // The cosine of the angle between what was found and the truth, about z.
        (rotation.x_axis.dot(want.x_axis) + rotation.y_axis.dot(want.y_axis)) < 0.0
    };
    group.instances.iter().filter(|i| is_flipped(i.id, i.world_from_template.rotation())).count()
}

/// Sampling makes either half turn fit better by some percent: paint decides. Without it half of them are flipped, which
/// is the planted error.
#[test]
fn paint_tells_front_from_back() {
    let of_all = |is_painted: bool| -> usize { (0..4).map(|seed| flipped(seed, is_painted)).sum() };
    let (painted, plain) = (of_all(true), of_all(false));
    println!("of {} painted cabinets {painted} flipped, of plain ones {plain}", 4 * (CABINETS - 1));
    assert!(painted == 0 && plain >= 4, "{painted} {plain}");
}
