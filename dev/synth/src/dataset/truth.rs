//! The exact groups and poses of a scene, and poses disturbed by a known amount.

use glam::{DMat3, DVec3};

use super::scene_builder::Scene;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{PosedGroup, PosedInstance};

/// A disturbance of poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseNoise {
    /// Angle by which every instance is turned about a random axis through its centre, degrees.
    pub degrees: f64,
    /// Distance by which every instance is moved in a random direction, as a part of its size, the diagonal of its
    /// bounding box. In groups of several sizes, scales also change by half this part, up or down.
    pub part: f64,
}

/// Stream of the disturbances, derived from the seed.
const NOISE_STREAM: u64 = 0x905E;

/// True pose and size of an object.
struct Known {
    id: u32,
    world_from_object: Similarity,
    /// Centre of its bounding box, object frame.
    centre: DVec3,
    /// Diagonal of its bounding box, world units.
    size: f64,
}

fn known(scene: &Scene, id: u32) -> Option<Known> {
    let body = scene.world.bodies().iter().find(|b| b.id == id)?;
    let bounds = scene.world.object_bounds(body);
    let world_from_object = body.world_from_object;
    let size = f64::from(bounds.diagonal()) * world_from_object.scale();
    Some(Known { id, world_from_object, centre: bounds.centre().as_dvec3(), size })
}

/// The groups as in `groups.json`: the template frame has the reference's orientation and scale, and its origin at the
/// centre of the object's box, so the reference's pose is a translation.
pub fn groups(scene: &Scene) -> Vec<PosedGroup> {
    posed(scene, |_, similarity| similarity)
}

/// The same groups with disturbed poses.
pub fn disturbed_groups(scene: &Scene, noise: PoseNoise, seed: u64) -> Vec<PosedGroup> {
    let rng = Rng::new(seed).fork(NOISE_STREAM);
    posed(scene, |(object, sizes_differ), pose| {
        let mut rng = rng.fork(u64::from(object.id));
        let turn = DMat3::from_axis_angle(rng.unit_vector(), noise.degrees.to_radians());
        let shift = rng.unit_vector() * (noise.part * object.size);
        let sign = if rng.chance(0.5) { 1.0 } else { -1.0 };
        let stretch = if sizes_differ { 1.0 + 0.5 * sign * noise.part } else { 1.0 };
        Similarity::from_parts(turn * pose.rotation(), stretch * pose.scale(), pose.translation() + shift)
    })
}

fn posed(scene: &Scene, change: impl Fn((&Known, bool), Similarity) -> Similarity) -> Vec<PosedGroup> {
    let group = |(template_id, kind): (usize, &super::world::Kind)| {
        let objects: Vec<Known> = kind.ids.iter().filter_map(|&id| known(scene, id)).collect();
        let reference = objects.first().map_or(Similarity::IDENTITY, |o| o.world_from_object);
        let differs = |o: &Known| (o.world_from_object.scale() / reference.scale() - 1.0).abs() > 1e-6;
        let sizes_differ = objects.iter().any(differs);
        let instance = |object: &Known| {
            let own = object.world_from_object;
            let rotation = own.rotation() * reference.rotation().transpose();
            let scale = own.scale() / reference.scale();
            let pose = Similarity::from_parts(rotation, scale, own.transform_point(object.centre));
            PosedInstance { id: object.id, world_from_template: change((object, sizes_differ), pose) }
        };
        let instances = objects.iter().map(instance).collect();
        PosedGroup { template_id: template_id as u32, name: Some(kind.name.clone()), score: None, instances }
    };
    scene.kinds.iter().enumerate().map(group).collect()
}
