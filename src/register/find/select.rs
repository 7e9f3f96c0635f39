//! The selected object: what is in the box without what it stands on; and everything else, as points of the same density.

use std::f64::consts::TAU;

use glam::DVec3;

use super::{FindError, FindInput, FindOptions};
use crate::math::rng::Rng;
use crate::math::sh::widened;
use crate::register::normals::Viewers;
use crate::register::options::RegisterOptions;
use crate::register::sample::{BASE, Disc, FEW_GAUSSIANS, ObjectSurface, SAMPLES, disc, discs, drawn, extents_of};
use crate::register::sample::{is_opaque, relaxed};
use crate::register::surface::Surface;
use crate::scene::ObjectBox;
use crate::scene::up_direction;

/// An axis of the box counts as up if it is within this angle of the pictures' up, radians (25 degrees): that is some
/// degrees off, or more where all cameras look down.
const BOX_UPRIGHT: f64 = 0.44;
/// Where the ground around the object is looked for: up to this many times the distance of the box's corners from its
/// axis, and this part of its height above and below its bottom.
pub(super) const AROUND: f64 = 1.6;
const NEAR_BOTTOM: f64 = 0.25;
/// A layer as thick as this part of the box's height that holds this part of all that is around the bottom, in so many of
/// eight directions, is what the object stands on. A wall that a window is in fills the height evenly.
const LAYER: f64 = 0.06;
const LAYER_PART: f64 = 0.4;
pub(super) const SECTORS: usize = 8;
const LAYER_SECTORS: usize = 6;
/// Fewest Gaussians of it.
const LAYER_GAUSSIANS: usize = 6;
/// Of the object is what is this part of its height above the middle of the layer.
const ABOVE: f64 = 0.04;
/// So many times the box must be explained: what goes on beyond it, as a floor beyond a table's top, is not the object. More
/// where sizes are free: a small crown lies well inside of a large one.
const SURROUNDINGS: f64 = 1.2;
const WIDE_SURROUNDINGS: f64 = 1.35;
/// Points drawn on the scene for each that is drawn on the object: the search needs fewer.
const SCENE_DENSITY: f64 = 0.7;
/// Most points of the scene.
const MOST_SCENE_SAMPLES: f64 = 3e6;
/// Sub-stream of the seed ("scen" in ASCII).
const SCENE_STREAM: u64 = 0x7363_656e;

/// The selected object and its surroundings. The local frame of both has the world's axes and its origin at the object's
/// centroid.
pub(super) struct Selected {
    /// Points of the object.
    pub surface: ObjectSurface,
    /// Points of everything, at the object's base voxel.
    pub scene: Surface,
    /// Unit vector up.
    pub up: DVec3,
    /// Height along `up`, local, of what the object stands on; above it the object begins.
    pub support: Option<f64>,
    /// The box, local.
    pub object_box: ObjectBox,
    /// What is in here, local, should be the object's: the box, or more of the surroundings where sizes are free.
    pub domain: ObjectBox,
    /// Middles of opaque Gaussians of any size, local: what things stand on.
    pub ground: Vec<DVec3>,
}

impl Selected {
    /// True for local points of the selected object's frame that should be its own: around it and above what it stands on.
    pub(super) fn holds(&self, p: DVec3) -> bool {
        self.support.is_none_or(|height| self.up.dot(p) > height) && self.domain.contains(p)
    }
}

/// Selects.
///
/// # Errors
/// A box with too few Gaussians of a surface in it.
pub(super) fn selected(input: &FindInput<'_>, options: &FindOptions) -> Result<Selected, FindError> {
    let FindInput { cloud, cameras, object, .. } = *input;
    let surfaces = &options.surfaces;
    let fail = |what: String| FindError::Selection { id: object.id, what };
    let up = up_of(input);
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

/// What is up.
fn up_of(input: &FindInput<'_>) -> DVec3 {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| input.object.world_from_box * axis);
    let given = input.up.and_then(DVec3::try_normalize);
    let Some(rough) = given.or_else(|| up_direction(input.cameras)) else { return axes[2] };
    let upright = axes.into_iter().flat_map(|axis| [axis, -axis]).find(|a| a.angle_between(rough) < BOX_UPRIGHT);
    if given.is_some() { rough } else { upright.unwrap_or(rough) }
}

/// Half the extent of a box along a direction.
pub(super) fn half_extent(object: &ObjectBox, direction: DVec3) -> f64 {
    0.5 * (object.world_from_box.inverse() * direction).abs().dot(object.size)
}

/// The largest level distance of a corner of a box from its middle.
pub(super) fn level_reach(object: &ObjectBox, up: DVec3) -> f64 {
    object.corners().iter().map(|c| (*c - object.center).reject_from(up).length()).fold(0.0, f64::max)
}

/// Which of the directions about `up` a level vector points to.
pub(super) fn sector(away: DVec3, up: DVec3) -> usize {
    let (side, front) = up.any_orthonormal_pair();
    let turn = front.dot(away).atan2(side.dot(away)) / TAU + 0.5;
    ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
}

/// The height along `up` (world) from which on Gaussians are the object's; `None` if it stands on nothing.
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
    // The layer that holds most.
    let mut best = 0..0;
    let mut end = 0;
    for first in 0..around.len() {
        while end < around.len() && around[end].0 <= around[first].0 + LAYER * height {
            end += 1;
        }
        if end - first > best.len() {
            best = first..end;
        }
    }
    let layer = &around[best];
    let sectors = (0..SECTORS).filter(|k| layer.iter().any(|l| l.1 == *k)).count();
    let is_support = layer.len() >= LAYER_GAUSSIANS
        && layer.len() as f64 >= LAYER_PART * around.len() as f64
        && sectors >= LAYER_SECTORS;
    is_support.then(|| bottom + layer[layer.len() / 2].0 + ABOVE * height)
}

/// Points of everything that is as opaque and small as what the object's points were drawn on.
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
