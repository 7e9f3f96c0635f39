//! How sure a pose is: it is found again from halves of what it was found from.
//!
//! An object says as much as it has Gaussians; the points drawn on them are not independent. So halves are halves of the
//! Gaussians: of the object, and of all that it is laid on. A pose found from a half is as far from that of the whole as
//! that of the whole is from the truth (the delete-half jackknife, Efron 1982). Starts that are off show, besides, whether
//! another pose nearby is as good; then that one counts.

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::decide::is_symmetry;
use super::icp::{IcpOptions, icp_apart, mean_distance};
use super::plane::{Slide, slide};
use super::pose::Pose;
use super::sample::{FINE, ObjectSurface};
use super::surface::{Sample, Surface};
use super::together::{Member, model_without, upright, upright_about};
use crate::math::eigen::symmetric_eigen;
use crate::math::rng::Rng;

/// Poses that are found again; in pairs from a half and the other half. A deviation from so many is known within a quarter.
const HALVES: usize = 8;
/// How far starts are turned, radians (8 degrees), and shifted, part of the object's size: the slats of a chair are so far
/// from each other.
const START_ANGLE: f64 = 0.14;
const START_SHIFT: f64 = 0.06;
/// A pose that is shifted by more than this part of the object's size is another one, not the same found less well.
const OTHER: f64 = 0.025;
/// Steps of each.
const STEPS: usize = 15;
/// An object that three turns about an axis bring onto itself is round: how it is turned about it has no meaning. Radians,
/// none a multiple of another: 20, 50 and 110 degrees.
const ROUND_TURNS: [f64; 3] = [0.35, 0.87, 1.92];
/// Sub-stream of the seed ("half" in ASCII).
const HALF_STREAM: u64 = 0x6861_6c66;

/// Standard deviations of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseUncertainty {
    /// Of its rotation: root mean square angle, degrees; about the axis of a round object none counts.
    pub degrees: f64,
    /// Of where the object's middle is: root mean square distance, part of the object's size.
    pub part: f64,
}

impl PoseUncertainty {
    /// Of one pose against another of independent errors.
    pub(super) fn and(self, other: Self) -> Self {
        Self { degrees: self.degrees.hypot(other.degrees), part: self.part.hypot(other.part) }
    }
}

/// What is known of the group for all halves.
#[derive(Clone, Copy)]
pub(super) struct Spread {
    /// The only axis that upright objects were turned about.
    pub axis: Option<DVec3>,
    /// Scale is free.
    pub allow_scale: bool,
    /// A cost above the least by a smaller part is as good.
    pub min_margin: f64,
    /// Seed of halves and starts.
    pub seed: u64,
}

/// How far a found pose is from that of the whole, in the target's frame.
struct Deviation {
    /// Rotation vector, radians.
    turn: DVec3,
    /// Of the object's middle, scene units.
    shift: DVec3,
}

impl Spread {
    /// The uncertainty of the k-th member's pose, `cost` being that of its lying on the reference, the first member. `None`
    /// if there is no other member.
    pub(super) fn of(&self, members: &[Member<'_>], k: usize, cost: f64) -> Option<PoseUncertainty> {
        let found: Vec<Deviation> =
            (0..HALVES).into_par_iter().map(|half| self.deviation(members, k, half)).collect::<Option<_>>()?;
        let Member { surface, pose } = members[k];
        let turns: Vec<DVec3> = found.iter().map(|d| d.turn).collect();
        let turns = without_round_axis(members[0].surface, &pose, turns, cost);
        let rms = |squares: f64| (squares / HALVES as f64).sqrt();
        Some(PoseUncertainty {
            degrees: rms(turns.iter().map(|t| t.length_squared()).sum()).to_degrees(),
            part: rms(found.iter().map(|d| d.shift.length_squared()).sum()) / surface.size,
        })
    }

    /// Finds the k-th member's pose again from a half; `None` if there is no other member.
    fn deviation(&self, members: &[Member<'_>], k: usize, half: usize) -> Option<Deviation> {
        let part = |i: usize| self.half_of(members[i].surface, half);
        let model = model_without(members, k, part)?;
        let Member { surface, pose } = members[k];
        let axis = self.axis.filter(|axis| upright_about(&pose, *axis));
        let rng = Rng::new(self.seed).fork(HALF_STREAM).fork(u64::from(surface.id)).fork((HALVES + half) as u64);
        let points = base_points(&part(k), surface);
        let options = IcpOptions { steps: STEPS, allow_scale: self.allow_scale };
        let mut found = Vec::new();
        for start in starts(&pose, surface.size, rng) {
            found.extend(icp_apart(&model, &points, start, options, &found));
        }
        let all: Vec<(Pose, f64)> = found.into_iter().map(|p| (p, mean_distance(&model, &points, &p))).collect();
        let best = *all.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let off = |found: &Pose| found.translation.distance(pose.translation);
        let is_rival = |f: &&(Pose, f64)| off(&f.0) > OTHER * surface.size && f.1 <= (1.0 + self.min_margin) * best.1;
        let rival = all.iter().filter(is_rival).max_by(|a, b| off(&a.0).total_cmp(&off(&b.0)));
        let mut found = rival.unwrap_or(&best).0;
        if let Some(axis) = axis {
            found.rotation = upright(found.rotation, axis);
        }
        let found = slide(&model, &points, found, Slide { steps: STEPS, allow_scale: self.allow_scale, axis });
        let motion = found.after(&pose.inverse());
        Some(Deviation { turn: DQuat::from_mat3(&motion.rotation).to_scaled_axis(), shift: motion.translation })
    }

    /// The finest points of half of an object's Gaussians, local frame. Of two halves that follow each other the second is
    /// the rest.
    fn half_of(&self, surface: &ObjectSurface, half: usize) -> Vec<Sample> {
        let mut order: Vec<usize> = (0..surface.discs).collect();
        Rng::new(self.seed).fork(HALF_STREAM).fork(u64::from(surface.id)).fork((half / 2) as u64).shuffle(&mut order);
        let mut is_first = vec![false; surface.discs];
        order[..surface.discs / 2].iter().for_each(|&disc| is_first[disc] = true);
        let samples = surface.levels[FINE].samples().into_iter().zip(&surface.disc_of_point);
        let kept = samples.filter(|(_, disc)| is_first[**disc as usize] == half.is_multiple_of(2));
        kept.map(|(sample, _)| sample).collect()
    }
}

/// Points of an object at the base level, with unit normals.
fn base_points(samples: &[Sample], surface: &ObjectSurface) -> Surface {
    let mut out = Surface::new(samples, surface.voxel());
    out.normals.iter_mut().for_each(|n| *n = n.normalize_or(DVec3::Z));
    out
}

/// A pose, and what is off it: turned, and shifted there and back.
fn starts(pose: &Pose, size: f64, mut rng: Rng) -> [Pose; 4] {
    let turned = DMat3::from_axis_angle(rng.unit_vector(), START_ANGLE) * pose.rotation;
    let shift = rng.unit_vector() * (START_SHIFT * size);
    let shifted = |by: DVec3| Pose { translation: pose.translation + by, ..*pose };
    [*pose, Pose { rotation: turned, ..*pose }, shifted(shift), shifted(-shift)]
}

/// Turns (of the target) without what is about the axis that they are mostly about, if the reference is round about it.
fn without_round_axis(reference: &ObjectSurface, pose: &Pose, turns: Vec<DVec3>, cost: f64) -> Vec<DVec3> {
    let mut moments = [[0.0; 3]; 3];
    for turn in &turns {
        for a in 0..3 {
            (0..3).for_each(|b| moments[a][b] += turn[a] * turn[b]);
        }
    }
    let axis = DVec3::from_array(symmetric_eigen(moments)[2].1);
    let own = pose.rotation.transpose() * axis;
    let brings_onto_itself = |angle: f64| {
        let motion = Pose::from_rotation(DMat3::from_axis_angle(own, angle));
        is_symmetry(reference, &motion, cost)
    };
    let is_round = own.is_normalized() && ROUND_TURNS.into_iter().all(brings_onto_itself);
    if is_round { turns.into_iter().map(|turn| turn.reject_from(axis)).collect() } else { turns }
}
