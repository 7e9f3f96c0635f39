//! Candidate poses of one object relative to another: starts from features and about the up axis are refined from
//! coarse to fine, and the best one is kept with its near ties.

use std::f64::consts::TAU;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::color::unexplained_color;
use super::global::{consensus_poses, mutual_matches};
use super::icp::{Fit, IcpOptions, fit, icp};
use super::options::RegisterOptions;
use super::plane::{Slide, slide};
use super::pose::{Pair, Pose};
use super::sample::{BASE, FINE, ObjectSurface};
use instgs_vk::math::rng::Rng;

/// Number of starts from features.
const CONSENSUS_MODES: usize = 3;
/// Largest number of ICP steps at each level.
const STEPS: usize = 15;
/// Largest number of point-to-plane steps at the end.
const SLIDES: usize = 12;
/// Number of hypotheses that go on from the second to the third level.
const KEPT: usize = 4;
/// Poses that differ by less than this angle, radians (8 degrees), ...
const SAME_ANGLE: f64 = 0.14;
/// ... and by less than this distance, base voxels, are the same.
const SAME_VOXELS: f64 = 1.5;

/// A candidate pose with its fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hypothesis {
    /// Maps the reference's local frame to the target's.
    pub pose: Pose,
    /// Fit of the two surfaces.
    pub fit: Fit,
    /// Part of the target's colour variation that the reference does not explain, 0..=1.
    pub color: f64,
}

/// Two objects that are compared.
#[derive(Clone, Copy)]
pub(super) struct ObjectPair<'a> {
    /// The object that is moved.
    pub reference: &'a ObjectSurface,
    /// The object that it is moved onto.
    pub target: &'a ObjectSurface,
}

/// Distinct poses whose cost is within the factor `near_tie` of the best, in order of cost.
pub(super) fn hypotheses(
    reference: &ObjectSurface,
    target: &ObjectSurface,
    up: Option<DVec3>,
    options: &RegisterOptions,
) -> Vec<Hypothesis> {
    let pair = ObjectPair { reference, target };
    let same = SAME_VOXELS * target.voxel();
    // Each level keeps fewer poses.
    let mut poses = starts(reference, target, up, options);
    for (level, most) in [(0, 2 * KEPT), (1, KEPT)] {
        let best = refined(pair, &poses, level, options);
        poses = distinct(best.into_iter().map(|(pose, _)| pose), |p| *p, same, most);
    }
    let mut near = refined(pair, &poses, BASE, options);
    let Some(best) = near.first().map(|n| n.1) else { return Vec::new() };
    near.retain(|n| n.1 <= options.near_tie * best);
    let near = distinct(near.into_iter(), |n| n.0, same, KEPT);
    let free = Slide { steps: SLIDES, allow_scale: options.allow_scale, axis: None };
    let last = |(pose, _): &(Pose, f64)| {
        let pose = slide(&reference.levels[FINE], &target.levels[BASE], *pose, free);
        Hypothesis { pose, fit: fit_at(pair, &pose, BASE), color: unexplained_color(reference, target, &pose) }
    };
    let mut all: Vec<Hypothesis> = near.par_iter().map(last).collect();
    all.sort_by(|a, b| a.fit.cost.total_cmp(&b.fit.cost));
    distinct(all.into_iter(), |h| h.pose, same, usize::MAX)
}

/// Poses from which refinement starts.
fn starts(
    reference: &ObjectSurface,
    target: &ObjectSurface,
    up: Option<DVec3>,
    options: &RegisterOptions,
) -> Vec<Pose> {
    let scale = if options.allow_scale { target.size / reference.size } else { 1.0 };
    let points = |(i, j): (usize, usize)| {
        let (from, to) = (reference.levels[BASE].positions[i], target.levels[BASE].positions[j]);
        Pair { from, to, weight: 1.0 }
    };
    let matches: Vec<Pair> = mutual_matches(&reference.features, &target.features).into_iter().map(points).collect();
    let rng = Rng::new(options.seed).fork(u64::from(target.id) << 32 | u64::from(reference.id));
    let (trials, scaled) = (options.trials, options.allow_scale);
    let mut out = consensus_poses(&matches, target.voxel(), trials, CONSENSUS_MODES, scaled, rng);
    let turned = |rotation: DMat3| Pose { rotation, scale, translation: DVec3::ZERO };
    let axis = up.unwrap_or(DVec3::Z);
    for i in 0..options.yaw_starts {
        let yaw = DMat3::from_axis_angle(axis, TAU * i as f64 / options.yaw_starts as f64);
        out.push(turned(yaw));
        // Without an up axis objects may also be upside down or lie on a side.
        if up.is_none() {
            out.extend([DVec3::X, DVec3::Y].map(|side| turned(yaw * DMat3::from_axis_angle(side, 0.25 * TAU))));
            out.extend([0.5, 0.75].map(|part| turned(yaw * DMat3::from_axis_angle(DVec3::X, part * TAU))));
            out.push(turned(yaw * DMat3::from_axis_angle(DVec3::Y, 0.75 * TAU)));
        }
    }
    out
}

/// Poses after the steps of one level, with their costs there, in order of cost.
fn refined(pair: ObjectPair<'_>, poses: &[Pose], level: usize, options: &RegisterOptions) -> Vec<(Pose, f64)> {
    let icp_options = IcpOptions { steps: STEPS, allow_scale: options.allow_scale };
    let refined = |&start: &Pose| {
        let pose = icp(&pair.reference.levels[FINE], &pair.target.levels[level], start, icp_options);
        (pose, fit_at(pair, &pose, level).cost)
    };
    let mut all: Vec<(Pose, f64)> = poses.par_iter().map(refined).collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    all
}

/// Fit of a pose of (reference, target) at a level.
pub(super) fn fit_at(pair: ObjectPair<'_>, pose: &Pose, level: usize) -> Fit {
    fit(pair.reference.at(level), pair.target.at(level), pose)
}

/// The first `most` items whose poses differ from all before them.
fn distinct<T>(all: impl Iterator<Item = T>, pose: impl Fn(&T) -> Pose, same: f64, most: usize) -> Vec<T> {
    let mut out: Vec<T> = Vec::new();
    for new in all {
        let p = pose(&new);
        let like = |old: &T| {
            let old = pose(old);
            old.angle_to(&p) < SAME_ANGLE && old.translation.distance(p.translation) < same
        };
        if out.len() < most && !out.iter().any(like) {
            out.push(new);
        }
    }
    out
}
