//! Refines given poses before a template is built: a template drawn from misaligned objects is blurred, and the joint
//! phase does not correct that.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::error::RegisterError;
use super::groups::{RegisterInput, validate};
use super::options::RegisterOptions;
use super::pose::Pose;
use super::sample::ObjectSurface;
use super::together::{Member, mean_cost, refine_together};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::PosedGroup;

/// Least part by which the mean distance between a group's objects must fall for refined poses to be used: correct
/// poses gain less by following the errors of the clouds.
const LEAST_GAIN: f64 = 0.025;
/// Rounds go on while the mean distance falls by at least this part: each object is aligned to others that move, too.
const GOES_ON: f64 = 0.01;
/// Largest number of rounds.
const MOST_ROUNDS: usize = 5;

/// The groups with each object aligned to all others of its group. The first object with enough Gaussians keeps its
/// pose; so do objects with too few, and groups that gain too little.
///
/// # Errors
/// Arrays of wrong length; an invalid camera or option.
pub fn polished(
    input: &RegisterInput<'_>,
    groups: &[PosedGroup],
    options: &RegisterOptions,
) -> Result<Vec<PosedGroup>, RegisterError> {
    options.validate()?;
    validate(input)?;
    let mut indices: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (i, &id) in input.instance_of_gaussian.iter().enumerate().filter(|(_, id)| **id != 0) {
        indices.entry(id).or_default().push(i as u32);
    }
    let surface = |id: u32| {
        let own = indices.get(&id)?;
        ObjectSurface::new(id, own, input.cloud, input.cameras, options).ok()
    };
    let of_group = |group: &PosedGroup| {
        let surfaces: Vec<Option<ObjectSurface>> =
            group.instances.par_iter().map(|object| surface(object.id)).collect();
        with_surfaces(group, &surfaces, options.allow_scale)
    };
    Ok(groups.iter().map(of_group).collect())
}

fn with_surfaces(group: &PosedGroup, surfaces: &[Option<ObjectSurface>], allow_scale: bool) -> PosedGroup {
    let mut out = group.clone();
    let seen: Vec<(usize, &ObjectSurface)> =
        surfaces.iter().enumerate().filter_map(|(k, surface)| Some((k, surface.as_ref()?))).collect();
    let Some((&(anchor, reference), others)) = seen.split_first().filter(|(_, others)| !others.is_empty()) else {
        return out;
    };
    let reference = PlacedSurface { surface: reference, place: group.instances[anchor].world_from_template };
    let mut members = vec![Member { surface: reference.surface, pose: Pose::IDENTITY }];
    members.extend(others.iter().map(|&(k, surface)| {
        let pose = local_pose(reference, PlacedSurface { surface, place: group.instances[k].world_from_template });
        Member { surface, pose }
    }));
    let before = mean_cost(&members);
    let mut cost = before;
    for _ in 0..MOST_ROUNDS {
        refine_together(&mut members, None, allow_scale);
        let last = std::mem::replace(&mut cost, mean_cost(&members));
        if cost > (1.0 - GOES_ON) * last {
            break;
        }
    }
    if cost < (1.0 - LEAST_GAIN) * before {
        for (&(k, surface), member) in others.iter().zip(&members[1..]) {
            out.instances[k].world_from_template = world_pose(reference, surface, &member.pose);
        }
    }
    out
}

/// An object's surface, and where the object stands.
#[derive(Clone, Copy)]
struct PlacedSurface<'a> {
    surface: &'a ObjectSurface,
    /// World from template.
    place: Similarity,
}

/// The pose from the reference's local frame to an object's, for given places of both.
fn local_pose(reference: PlacedSurface<'_>, target: PlacedSurface<'_>) -> Pose {
    let (from, to) = (reference.place, target.place);
    let rotation = to.rotation() * from.rotation().transpose();
    let scale = to.scale() / from.scale();
    let of_centroid = to.translation() + rotation * (reference.surface.centroid - from.translation()) * scale;
    Pose { rotation, scale, translation: of_centroid - target.surface.centroid }
}

/// The inverse of [`local_pose`]: an object's place in the world for its pose.
fn world_pose(reference: PlacedSurface<'_>, target: &ObjectSurface, pose: &Pose) -> Similarity {
    let from = reference.place;
    let rotation: DMat3 = pose.rotation * from.rotation();
    let translation: DVec3 = target.centroid + pose.apply(from.translation() - reference.surface.centroid);
    Similarity::from_parts(rotation, pose.scale * from.scale(), translation)
}
