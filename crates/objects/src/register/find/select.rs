//! Samples the selected object, the contents of the box without its support, and the whole scene at the same density.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{FindError, FindInput, FindOptions};
use crate::register::normals::Viewers;
use crate::register::options::RegisterOptions;
use crate::register::sample::{BASE, Disc, FEW_GAUSSIANS, ObjectSurface, SAMPLES, disc, discs, drawn, extents_of};
use crate::register::sample::{is_opaque, relaxed};
use crate::register::surface::Surface;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::ObjectBox;
use instgs_vk::scene::UpAxes;

/// Largest angle between an axis of the box and the cameras' up direction for the axis to be the up axis, radians (25
/// degrees): the cameras' direction is inaccurate, most of all if all of them look down.
const BOX_UPRIGHT: f64 = 0.44;
/// Radius in which the support is searched, in distances of the box's corners from its axis.
pub(super) const AROUND: f64 = 1.6;
/// Height in which it is searched above and below the box's bottom, as a part of the box's height.
const NEAR_BOTTOM: f64 = 0.25;
/// Thickness of the layer that supports an object, as a part of the box's height: the first that holds enough Gaussians. The
/// ground of early clouds is rough.
const LAYERS: [f64; 2] = [0.06, 0.12];
/// Least part of the Gaussians around the bottom in the layer: a wall around a window fills the height evenly.
const LAYER_PART: f64 = 0.4;
/// Number of sectors that directions about the up axis are divided into.
pub(super) const SECTORS: usize = 8;
/// Least number of sectors with Gaussians of the layer.
const LAYER_SECTORS: usize = 6;
/// Least number of Gaussians in the layer.
const LAYER_GAUSSIANS: usize = 6;
/// The object begins this part of the layer's thickness above its median.
const ABOVE: f64 = 2.0 / 3.0;
/// The object must explain the points in this many times its box: a surface that goes on beyond the box, like a floor
/// beyond a table's top, is not the object.
const SURROUNDINGS: f64 = 1.2;
/// The same if sizes are free: a small crown lies well inside a large one.
const WIDE_SURROUNDINGS: f64 = 1.35;
/// Density of points on the scene relative to the object's: the search needs fewer.
const SCENE_DENSITY: f64 = 0.7;
/// Largest number of points drawn on the scene.
const MOST_SCENE_SAMPLES: f64 = 3e6;
/// Stream of the random points ("scen" in ASCII), derived from the seed.
const SCENE_STREAM: u64 = 0x7363_656e;

/// The selected object and its surroundings. Both use the local frame with the world's axes and its origin at the
/// object's centroid.
pub(super) struct Selected {
    /// Surface points of the object.
    pub surface: ObjectSurface,
    /// Points of the whole scene at the object's base voxel.
    pub scene: Surface,
    /// Up axis, a unit vector.
    pub up: DVec3,
    /// Height along `up`, local, of the object's support; the object begins above it.
    pub support: Option<f64>,
    /// The selected box, local frame.
    pub object_box: ObjectBox,
    /// Local region in which all points should be the object's: the box and some surroundings, more if sizes are free.
    pub domain: ObjectBox,
    /// Centres of opaque Gaussians of any size, local: what objects may stand on.
    pub ground: Vec<DVec3>,
}

impl Selected {
    /// Whether a local point of the selected object's frame is in the region that the object must explain.
    pub(super) fn holds(&self, p: DVec3) -> bool {
        self.support.is_none_or(|height| self.up.dot(p) > height) && self.domain.contains(p)
    }
}

/// Selects the contents of the box, with `up` as the up axis.
///
/// # Errors
/// A box with too few surface Gaussians in it.
pub(super) fn selected(input: &FindInput<'_>, up: DVec3, options: &FindOptions) -> Result<Selected, FindError> {
    let FindInput { cloud, cameras, object, .. } = *input;
    let surfaces = &options.surfaces;
    let fail = |what: String| FindError::Selection { id: object.id, what };
    let opaque: Vec<u32> =
        (0..cloud.len() as u32).filter(|&i| is_opaque(cloud, i as usize, 0.5 * surfaces.min_opacity)).collect();
    let place = |i: u32| widened(cloud.means[i as usize]);
    let ground: Vec<DVec3> =
        opaque.iter().filter(|&&i| is_opaque(cloud, i as usize, surfaces.min_opacity)).map(|&i| place(i)).collect();
    let support = support(&ground, object, up);
    let is_own = |&i: &u32| object.contains(place(i)) && support.is_none_or(|height| up.dot(place(i)) > height);
    let own: Vec<u32> = opaque.iter().copied().filter(is_own).collect();
    let surface = ObjectSurface::new(object.id, &own, cloud, cameras, surfaces)
        .map_err(|reason| fail(format!("selects no object: {reason}; draw it around one")))?;
    let few = discs(cloud, &own, cameras, surfaces).len() < FEW_GAUSSIANS;
    let limits = if few { relaxed(surfaces) } else { *surfaces };
    let scene = scene_surface(input, &own, &opaque, &surface, &limits);
    let support = support.map(|height| height - up.dot(surface.centroid));
    let object_box = ObjectBox { center: object.center - surface.centroid, ..object.clone() };
    let wider = if options.min_scale < 1.0 { WIDE_SURROUNDINGS } else { SURROUNDINGS };
    let domain = ObjectBox { size: object_box.size * wider, ..object_box.clone() };
    let ground = ground.into_iter().map(|p| p - surface.centroid).collect();
    Ok(Selected { surface, scene, up, support, object_box, domain, ground })
}

/// The up axis of a search, and the one to try if that finds nothing. Given; or the axis of the box nearest to the cameras' up axis,
/// or that, and then the same for what the cameras look straight at: the ground of a flight, or a wall. Without any it is the box's
/// third axis.
pub(super) fn up_axes(input: &FindInput<'_>) -> (DVec3, Option<DVec3>) {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| input.object.world_from_box * axis);
    if let Some(given) = input.up.and_then(DVec3::try_normalize) {
        return (given, None);
    }
    let upright = |rough: DVec3| {
        let mut both = axes.into_iter().flat_map(|axis| [axis, -axis]);
        both.find(|axis| axis.angle_between(rough) < BOX_UPRIGHT).unwrap_or(rough)
    };
    let UpAxes { level, straight } = UpAxes::of(input.cameras, input.cloud.means.iter().copied());
    let (level, straight) = (level.map(upright), straight.map(upright));
    (level.or(straight).unwrap_or(axes[2]), level.and(straight))
}

/// Half the extent of a box along a unit vector.
pub(super) fn half_extent(object: &ObjectBox, direction: DVec3) -> f64 {
    0.5 * (object.world_from_box.inverse() * direction).abs().dot(object.size)
}

/// Largest distance of a corner of a box from its upright axis.
pub(super) fn level_reach(object: &ObjectBox, up: DVec3) -> f64 {
    object.corners().iter().map(|c| (*c - object.center).reject_from(up).length()).fold(0.0, f64::max)
}

/// Sector about `up` that a level vector points to.
pub(super) fn sector(away: DVec3, up: DVec3) -> usize {
    let (side, front) = up.any_orthonormal_pair();
    let turn = front.dot(away).atan2(side.dot(away)) / TAU + 0.5;
    ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
}

/// Height along `up` (world) at which the object begins; `None` if it stands on nothing.
fn support(ground: &[DVec3], object: &ObjectBox, up: DVec3) -> Option<f64> {
    let half_height = half_extent(object, up);
    let height = 2.0 * half_height;
    let bottom = up.dot(object.center) - half_height;
    let reach = AROUND * level_reach(object, up);
    let mut around: Vec<(f64, usize)> = Vec::new();
    for &p in ground {
        let level = up.dot(p) - bottom;
        let away = (p - object.center).reject_from(up);
        if level.abs() < NEAR_BOTTOM * height && away.length() < reach && !object.contains(p) {
            around.push((level, sector(away, up)));
        }
    }
    around.sort_by(|a, b| a.0.total_cmp(&b.0));
    let begins = |part: f64| {
        let layer = densest_layer(&around, part * height)?;
        let sectors = (0..SECTORS).filter(|k| layer.iter().any(|l| l.1 == *k)).count();
        let is_support = layer.len() >= LAYER_GAUSSIANS
            && layer.len() as f64 >= LAYER_PART * around.len() as f64
            && sectors >= LAYER_SECTORS;
        is_support.then(|| bottom + layer[layer.len() / 2].0 + ABOVE * part * height)
    };
    LAYERS.into_iter().find_map(begins)
}

/// The part of ascending heights, each with its sector, within a layer of this thickness that has most of them; the lowest of
/// several, `None` without any.
pub(super) fn densest_layer(heights: &[(f64, usize)], thickness: f64) -> Option<&[(f64, usize)]> {
    let (mut best, mut end) = (0..0, 0);
    for first in 0..heights.len() {
        end += heights[end..].iter().take_while(|h| h.0 <= heights[first].0 + thickness).count();
        if end - first > best.len() {
            best = first..end;
        }
    }
    (!best.is_empty()).then(|| &heights[best])
}

/// Points of the whole scene, on Gaussians within the same limits of opacity and size as the object's points.
fn scene_surface(
    input: &FindInput<'_>,
    own: &[u32],
    opaque: &[u32],
    surface: &ObjectSurface,
    limits: &RegisterOptions,
) -> Surface {
    let cloud = input.cloud;
    let of_object = discs(cloud, own, input.cameras, limits);
    let places: Vec<DVec3> = of_object.iter().map(|d| d.position).collect();
    let max_scale = limits.max_relative_scale * extents_of(&places).length();
    let viewers = Viewers::new(input.cameras, surface.centroid);
    let small = |&i: &u32| disc(cloud, i as usize, &viewers, max_scale);
    let all: Vec<Disc> =
        opaque.iter().filter(|&&i| is_opaque(cloud, i as usize, limits.min_opacity)).filter_map(small).collect();
    let step = of_object.iter().map(|d| d.weight).sum::<f64>() / (SCENE_DENSITY * SAMPLES as f64);
    let step = step.max(all.iter().map(|d| d.weight).sum::<f64>() / MOST_SCENE_SAMPLES);
    let mut samples = drawn(&all, step, Rng::new(limits.seed).fork(SCENE_STREAM));
    samples.iter_mut().for_each(|s| s.position -= surface.centroid);
    Surface::new(&samples, surface.levels[BASE].voxel)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;
    use instgs_vk::scene::{Camera, Gaussians};

    use super::*;

    /// A flight over a field with the north above is searched about the north first, then about the vertical.
    #[test]
    fn a_flight_has_two_axes_to_try() {
        let mut cloud = Gaussians::with_capacity(0, 0);
        let mut rng = Rng::new(5);
        cloud.means.extend((0..500).map(|_| [rng.range(0.0, 9.0) as f32, rng.range(0.0, 9.0) as f32, 0.0]));
        let camera = |i: u32, up: DVec3| {
            let eye = DVec3::new(f64::from(i), 4.0, 9.0);
            Camera::look_at("", eye, eye + DVec3::NEG_Z, up, 0.9, (64, 48))
        };
        let there_and_back = |i: u32| if i.is_multiple_of(2) { DVec3::X } else { DVec3::NEG_X };
        let north: Vec<Camera> = (0..8).map(|i| camera(i, DVec3::Y)).collect();
        let both: Vec<Camera> = (0..8).map(|i| camera(i, there_and_back(i))).collect();
        let lying = DQuat::from_rotation_x(1.5);
        let found = |cameras: &[Camera], world_from_box: DQuat, up: Option<DVec3>| {
            let size = DVec3::ONE;
            let object = ObjectBox { id: 1, category: None, center: DVec3::ZERO, size, world_from_box };
            up_axes(&FindInput { cloud: &cloud, cameras, object: &object, up })
        };
        assert_eq!(found(&north, DQuat::IDENTITY, None), (DVec3::Y, Some(DVec3::Z)));
        assert_eq!(found(&both, DQuat::IDENTITY, None), (DVec3::Z, None));
        assert_eq!(found(&[], lying, None), (lying * DVec3::Z, None));
        assert_eq!(found(&north, DQuat::IDENTITY, Some(DVec3::X * 2.0)), (DVec3::X, None));
        // The axes of a box that is about upright are more exact.
        let (first, second) = found(&north, lying, None);
        assert_eq!((first, second), (-(lying * DVec3::Z), Some(lying * DVec3::Y)));
    }
}
