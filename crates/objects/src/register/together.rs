//! Aligns all objects of a group at once: each with the union of all others, upright objects about the up axis only.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::icp::{IcpOptions, icp, mean_distance};
use super::plane::{Slide, slide};
use super::pose::Pose;
use super::sample::{BASE, FINE, ObjectSurface};
use super::surface::Surface;
use super::unions::Unions;
use instgs_vk::math::eigen::symmetric_eigen;

/// Rounds in which every object is aligned with all others.
const ROUNDS: usize = 4;
/// Largest number of steps for each refinement.
const STEPS: usize = 12;
/// Largest angle between the up axes of objects on one floor when registered alone, radians (4 degrees).
const UPRIGHT: f64 = 0.07;
/// Least part of the objects of a group that stands upright for the group to have an up axis.
const MOST_STAND: f64 = 2.0 / 3.0;
/// Part of the objects, the least tilted, whose tilts tell two axes apart: a single pose may be wrong.
const STANCE_PART: f64 = 0.8;
/// Objects tilted by more than this from the cameras' up direction do not stand upright, radians (20 degrees): that
/// direction is only accurate to some degrees.
const FAR: f64 = 0.35;
/// Weight of the cameras' up direction relative to each object's rotation, whose weight is up to 4: it is inaccurate.
const UP_WEIGHT: f64 = 0.05;

/// An object and its pose, from the group's frame to its own.
#[derive(Clone, Copy)]
pub(super) struct Member<'a> {
    /// Surface points of the object.
    pub surface: &'a ObjectSurface,
    /// Maps the group's frame to the object's local frame.
    pub pose: Pose,
}

/// Another pose that an object might have.
#[derive(Clone, Copy)]
pub(super) struct Rival {
    /// Maps the group's frame to the object's local frame.
    pub pose: Pose,
    /// Its surface cost relative to that of the present pose; below 1 it fits better.
    pub surface: f64,
}

/// Refines the poses of `members`; the first is the reference and keeps the identity. Upright members are turned about
/// `axis` only.
pub(super) fn refine_together(members: &mut [Member<'_>], axis: Option<DVec3>, allow_scale: bool) {
    for _ in 0..ROUNDS {
        let unions = Unions::of_all(members);
        let refined = |(k, member): (usize, &Member<'_>)| {
            let mut start = member.pose;
            let axis = axis.filter(|axis| upright_about(&start, *axis));
            if let Some(axis) = axis {
                start.rotation = upright(start.rotation, axis);
            }
            let Some(model) = unions.without(k) else { return start };
            slide(model, &member.surface.levels[FINE], start, Slide { steps: STEPS, allow_scale, axis })
        };
        let poses: Vec<Pose> = members.par_iter().enumerate().map(refined).collect();
        let of_reference = poses[0].inverse();
        members.iter_mut().zip(poses).for_each(|(member, pose)| member.pose = pose.after(&of_reference));
        members[0].pose = Pose::IDENTITY;
    }
}

/// Mean distance of each object's points from the union of all others, in voxels of the object, each clamped to
/// [`MOST_VOXELS`](super::icp::MOST_VOXELS); the mean over the objects.
pub(super) fn mean_cost(members: &[Member<'_>]) -> f64 {
    let unions = Unions::of_all(members);
    let cost = |(k, member): (usize, &Member<'_>)| {
        Some(mean_distance(unions.without(k)?, &member.surface.levels[BASE], &member.pose))
    };
    let costs: Vec<f64> = members.par_iter().enumerate().filter_map(cost).collect();
    costs.iter().sum::<f64>() / costs.len().max(1) as f64
}

/// A pose turned by 180 degrees about `up` through the object's centre: front and back of many objects are alike.
pub(super) fn half_turned(pose: &Pose, up: DVec3) -> Pose {
    let rotation = DMat3::from_axis_angle(up, std::f64::consts::PI) * pose.rotation;
    // The point nearest to the centroid stays there.
    Pose { rotation, translation: -(rotation * pose.apply_inverse(DVec3::ZERO)) * pose.scale, ..*pose }
}

/// Other poses of an object, refined against `model`, the union of all others, each with its cost relative to the present
/// pose's. The union of all objects tells poses apart that one partly seen object does not. Rivals get all steps of
/// refinement, since costs differ by less than the last step gains. Empty without another pose.
pub(super) fn rivals_of(model: &Surface, member: Member<'_>, starts: &[Pose], allow_scale: bool) -> Vec<Rival> {
    let Member { surface, pose } = member;
    let cost = |pose: &Pose| mean_distance(model, &surface.levels[BASE], pose);
    let refined = |start: &Pose| {
        let mut pose = *start;
        for level in [BASE - 1, BASE] {
            pose = icp(model, &surface.levels[level], pose, IcpOptions { steps: STEPS, allow_scale });
        }
        pose = slide(model, &surface.levels[FINE], pose, Slide { steps: STEPS, allow_scale, axis: None });
        (pose, cost(&pose))
    };
    // The present pose is refined in the same way: with the up axis enforced it may fit worse than a free rival.
    let own = cost(&pose).min(refined(&pose).1);
    let rivals = starts.iter().map(refined).map(|(pose, cost)| Rival { pose, surface: cost / own });
    rivals.filter(|rival| rival.surface.is_finite()).collect()
}

/// The direction that the rotations of all upright objects leave fixed, as far as they determine it; near `up`. Objects
/// on one floor have one axis, whatever their group; two objects with nearly the same orientation would not determine
/// it. Poses registered alone give the best estimate: those refined together share their errors.
pub(super) fn common_axis<'a>(members: impl Iterator<Item = &'a Member<'a>> + Clone, up: DVec3) -> DVec3 {
    let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
    let prior = (DMat3::IDENTITY - outer(up)) * UP_WEIGHT;
    let mut axis = up;
    // First from all objects that are not far off, then from those upright about the last estimate.
    for limit in [FAR, UPRIGHT, UPRIGHT] {
        let differences = members.clone().filter(|m| tilt(&m.pose, axis) <= limit);
        let moved =
            differences.map(|m| m.pose.rotation - DMat3::IDENTITY).fold(prior, |sum, d| sum + d.transpose() * d);
        let (_, least) = symmetric_eigen(moved.to_cols_array_2d())[0];
        let found = DVec3::from_array(least);
        axis = if found.dot(axis) < 0.0 { -found } else { found };
    }
    axis
}

/// Whether a pose tilts the axis so little that the object stands upright.
pub(super) fn upright_about(pose: &Pose, axis: DVec3) -> bool {
    tilt(pose, axis) <= UPRIGHT
}

/// Angle by which a pose tilts the axis, radians.
fn tilt(pose: &Pose, axis: DVec3) -> f64 {
    (pose.rotation * axis).angle_between(axis)
}

/// How well objects stand upright about an axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stance {
    /// The part of them that does, 0..=1.
    pub upright_part: f64,
    /// Root mean square of their tilts, radians, each at most [`FAR`], without the most tilted ones.
    pub tilt: f64,
}

impl Stance {
    /// Of objects about `axis`; all 0 without objects.
    pub(super) fn of<'a>(members: impl Iterator<Item = &'a Member<'a>>, axis: DVec3) -> Self {
        let mut tilts: Vec<f64> = members.map(|member| tilt(&member.pose, axis)).collect();
        tilts.sort_by(f64::total_cmp);
        let upright = tilts.iter().filter(|tilt| **tilt <= UPRIGHT).count();
        let kept = (STANCE_PART * tilts.len() as f64).ceil() as usize;
        let squares: f64 = tilts[..kept].iter().map(|tilt| tilt.min(FAR).powi(2)).sum();
        Self { upright_part: upright as f64 / tilts.len().max(1) as f64, tilt: (squares / kept.max(1) as f64).sqrt() }
    }

    /// Whether so many stand upright that the axis is the up axis of all that are not tilted.
    pub(super) fn is_upright(self) -> bool {
        self.upright_part >= MOST_STAND
    }
}

/// The turn about the axis that is nearest to the rotation.
pub(super) fn upright(rotation: DMat3, axis: DVec3) -> DMat3 {
    let side = axis.any_orthonormal_vector();
    let turned = rotation * side;
    let angle = axis.cross(side).dot(turned).atan2(side.dot(turned));
    DMat3::from_axis_angle(axis, angle)
}
