//! Uncertainty of a pose: it is recomputed from halves of the Gaussians (delete-half jackknife).
//!
//! The evidence of an object is its Gaussians; points drawn on them are not independent. So the Gaussians are halved:
//! those of the object, and those of all objects it is aligned to. The deviation of a half's pose from the whole's has
//! the standard deviation of the whole's error (Efron 1982). Starts that are off also reveal nearby poses that fit
//! about as well; then the farthest of these counts.

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::decide::is_symmetry;
use super::icp::{IcpOptions, icp_apart, mean_distance};
use super::plane::{Slide, slide};
use super::pose::Pose;
use super::sample::{FINE, ObjectSurface};
use super::surface::{Sample, Surface};
use super::together::{Member, upright, upright_about};
use super::unions::Unions;
use instgs_vk::math::eigen::symmetric_eigen;
use instgs_vk::math::rng::Rng;

/// Number of recomputed poses, in pairs of a half and the other half; it gives a standard deviation to about a quarter.
const HALVES: usize = 8;
/// Starts are turned by this angle, radians (8 degrees), ...
const START_ANGLE: f64 = 0.14;
/// ... or shifted by this part of the object's size, the distance between slats of a chair.
const START_SHIFT: f64 = 0.06;
/// A pose shifted by more than this part of the object's size is a different one, not a less accurate one.
const OTHER: f64 = 0.025;
/// Largest number of steps for each refinement.
const STEPS: usize = 15;
/// An object that these three turns about an axis map onto itself is round, and its turn about that axis has no
/// meaning. Radians (20, 50 and 110 degrees), none a multiple of another.
const ROUND_TURNS: [f64; 3] = [0.35, 0.87, 1.92];
/// Stream of the random halves ("half" in ASCII), derived from the seed.
const HALF_STREAM: u64 = 0x6861_6c66;

/// Standard deviations of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseUncertainty {
    /// Rotation: root mean square angle, degrees; turns about the axis of a round object do not count.
    pub degrees: f64,
    /// Position of the object's centre: root mean square distance, part of the object's size.
    pub part: f64,
}

impl PoseUncertainty {
    /// Uncertainty of one pose relative to another with independent errors.
    pub(super) fn and(self, other: Self) -> Self {
        Self { degrees: self.degrees.hypot(other.degrees), part: self.part.hypot(other.part) }
    }
}

/// Settings for estimating uncertainties in a group.
#[derive(Clone, Copy)]
pub(super) struct Spread {
    /// The only axis of rotation of upright objects.
    pub axis: Option<DVec3>,
    /// Whether the scale is free.
    pub allow_scale: bool,
    /// Poses whose cost is above the least by a smaller part than this fit as well.
    pub min_margin: f64,
    /// Seed of halves and starts.
    pub seed: u64,
}

/// Deviation of a recomputed pose from the pose of the whole, in the target's frame.
#[derive(Clone, Copy)]
struct Deviation {
    /// Rotation vector, radians.
    turn: DVec3,
    /// Displacement of the object's centre, scene units.
    shift: DVec3,
}

impl Spread {
    /// Uncertainty of each member's pose; `costs` are those of their fits to the reference, the first member, whose own is
    /// that of a usual fit. `None` without another member, and for the reference of two, whose pose is not refined.
    pub(super) fn of_all(&self, members: &[Member<'_>], costs: &[f64]) -> Vec<Option<PoseUncertainty>> {
        let first = usize::from(members.len() == 2);
        let of_half = |half: usize| -> Vec<Option<Deviation>> {
            let unions = Unions::new(members, |i| self.half_of(members[i].surface, half));
            let of = |k: usize| self.deviation(unions.without(k)?, members[k], half);
            (0..members.len()).into_par_iter().map(|k| (k >= first).then(|| of(k)).flatten()).collect()
        };
        let halves: Vec<Vec<Option<Deviation>>> = (0..HALVES).into_par_iter().map(of_half).collect();
        let of = |k: usize| {
            let found: Vec<Deviation> = halves.iter().map(|half| half[k]).collect::<Option<_>>()?;
            Some(uncertainty(members[0].surface, members[k], &found, costs[k]))
        };
        (0..members.len()).into_par_iter().map(of).collect()
    }

    /// Recomputes a member's pose from a half of its Gaussians and `model`, the union of halves of the others.
    fn deviation(&self, model: &Surface, member: Member<'_>, half: usize) -> Option<Deviation> {
        let Member { surface, pose } = member;
        let axis = self.axis.filter(|axis| upright_about(&pose, *axis));
        let rng = Rng::new(self.seed).fork(HALF_STREAM).fork(u64::from(surface.id)).fork((HALVES + half) as u64);
        let points = base_points(&self.half_of(surface, half), surface);
        let options = IcpOptions { steps: STEPS, allow_scale: self.allow_scale };
        let mut found = Vec::new();
        for start in starts(&pose, surface.size, rng) {
            found.extend(icp_apart(model, &points, start, options, &found));
        }
        let all: Vec<(Pose, f64)> = found.into_iter().map(|p| (p, mean_distance(model, &points, &p))).collect();
        let best = *all.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let off = |found: &Pose| found.translation.distance(pose.translation);
        let is_rival = |f: &&(Pose, f64)| off(&f.0) > OTHER * surface.size && f.1 <= (1.0 + self.min_margin) * best.1;
        let rival = all.iter().filter(is_rival).max_by(|a, b| off(&a.0).total_cmp(&off(&b.0)));
        let mut found = rival.unwrap_or(&best).0;
        if let Some(axis) = axis {
            found.rotation = upright(found.rotation, axis);
        }
        let found = slide(model, &points, found, Slide { steps: STEPS, allow_scale: self.allow_scale, axis });
        let motion = found.after(&pose.inverse());
        Some(Deviation { turn: DQuat::from_mat3(&motion.rotation).to_scaled_axis(), shift: motion.translation })
    }

    /// Finest points of one half of an object's Gaussians, local frame. Halves 2i and 2i + 1 complement each other.
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

/// The uncertainty of a member's pose, from its deviations for all halves.
fn uncertainty(reference: &ObjectSurface, member: Member<'_>, found: &[Deviation], cost: f64) -> PoseUncertainty {
    let turns: Vec<DVec3> = found.iter().map(|d| d.turn).collect();
    let turns = without_round_axis(reference, &member.pose, turns, cost);
    let rms = |squares: f64| (squares / HALVES as f64).sqrt();
    PoseUncertainty {
        degrees: rms(turns.iter().map(|t| t.length_squared()).sum()).to_degrees(),
        part: rms(found.iter().map(|d| d.shift.length_squared()).sum()) / member.surface.size,
    }
}

/// Points of an object at the base level, with unit normals.
fn base_points(samples: &[Sample], surface: &ObjectSurface) -> Surface {
    let mut out = Surface::new(samples, surface.voxel());
    out.normals.iter_mut().for_each(|n| *n = n.normalize_or(DVec3::Z));
    out
}

/// The pose itself, and the pose turned and shifted there and back.
fn starts(pose: &Pose, size: f64, mut rng: Rng) -> [Pose; 4] {
    let turned = DMat3::from_axis_angle(rng.unit_vector(), START_ANGLE) * pose.rotation;
    let shift = rng.unit_vector() * (START_SHIFT * size);
    let shifted = |by: DVec3| Pose { translation: pose.translation + by, ..*pose };
    [*pose, Pose { rotation: turned, ..*pose }, shifted(shift), shifted(-shift)]
}

/// Rotation vectors without their component along their main axis, if the reference is round about it.
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
