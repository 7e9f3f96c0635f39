//! The members of a group after each was registered to the reference.

use glam::DVec3;
use rayon::prelude::*;

use super::check::{Agreement, PoseCheck};
use super::color::unexplained_color;
use super::decide::{Certainty, Decision, doubt_ratio, is_symmetry};
use super::error::RegisterError;
use super::hypotheses::{ObjectPair, fit_at};
use super::options::RegisterOptions;
use super::outcome::target_from_reference;
use super::pose::Pose;
use super::sample::{BASE, ObjectSurface};
use super::spread::{PoseUncertainty, Spread};
use super::together::{Member, Rival, Stance, common_axis, half_turned, refine_together, rivals_of};
use super::unions::Unions;

/// From this many members on, all others together are better evidence than the reference alone.
const ENOUGH: usize = 3;
/// Rivals whose surface and colours fit worse than by this factor are not compared in pictures: pictures of front and
/// back of one object differ by less.
const WORTH_PICTURES: f64 = 1.25;

/// Objects stand rather about an axis if their tilts are smaller by this factor: where all face one way both are about the same.
const RATHER: f64 = 0.5;
/// Poses that are turned against each other by less are one, radians (10 degrees).
const SAME_POSE: f64 = 0.17;

/// A member and its pose relative to the reference.
pub(super) struct Aligned<'a> {
    /// Surface points of the member.
    pub surface: &'a ObjectSurface,
    /// Its pose, and how certain it is.
    pub decision: Decision,
}

/// A group whose poses are not yet final.
pub(super) struct Group<'a> {
    /// Category of the group.
    pub name: Option<&'a String>,
    /// The object that the others are registered to.
    pub reference: &'a ObjectSurface,
    /// The other members, at least one; by id.
    pub members: Vec<Aligned<'a>>,
    /// The reference and the other members with their current poses.
    placed: Vec<Member<'a>>,
}

impl<'a> Group<'a> {
    /// A group with each member at its pose relative to the reference alone.
    pub(super) fn new(name: Option<&'a String>, reference: &'a ObjectSurface, mut members: Vec<Aligned<'a>>) -> Self {
        members.sort_by_key(|m| m.surface.id);
        let mut placed = vec![Member { surface: reference, pose: Pose::IDENTITY }];
        placed.extend(members.iter().map(|m| Member { surface: m.surface, pose: m.decision.hypothesis.pose }));
        Self { name, reference, members, placed }
    }

    /// The up axis of the upright objects of all groups; `up` is the first estimate.
    pub(super) fn axis_of(groups: &[Self], up: DVec3) -> DVec3 {
        common_axis(groups.iter().flat_map(|group| &group.placed[1..]), up)
    }

    /// Whether objects stand upright about `normal`, that of what the cameras look straight at, rather than about `up`, the axis of the
    /// cameras. Cars of a car park below a flight do, since `up` is the north there; goods on a shelf stand upright about both.
    pub(super) fn stand_rather_about(groups: &[Self], normal: DVec3, up: DVec3) -> bool {
        let others = || groups.iter().flat_map(|group| &group.placed[1..]);
        let [about_normal, about_up] = [normal, up].map(|near| Stance::of(others(), Self::axis_of(groups, near)));
        about_normal.is_upright() && about_normal.tilt < RATHER * about_up.tilt
    }

    /// Aligns the members with each other and replaces a pose by a rival that fits better. If most members stand
    /// upright, those are turned about `axis` only. Returns the uncertainty of each member's pose.
    ///
    /// # Errors
    /// Errors of `check`.
    pub(super) fn settle(
        &mut self,
        axis: Option<DVec3>,
        check: Option<&mut (dyn PoseCheck + '_)>,
        options: &RegisterOptions,
    ) -> Result<Vec<Option<PoseUncertainty>>, RegisterError> {
        let (scale, all) = (options.allow_scale, &mut self.placed);
        let upright = axis.filter(|axis| Stance::of(all[1..].iter(), *axis).is_upright());
        refine_together(all, upright, scale);
        let unions = Unions::of_all(all);
        let rival = |(k, member): (usize, &Aligned<'_>)| {
            let Some(model) = unions.without(k + 1) else { return Vec::new() };
            let turned = axis.map(|axis| half_turned(&all[k + 1].pose, axis));
            let starts: Vec<Pose> = member.decision.rivals.iter().copied().chain(turned).collect();
            rivals_of(model, all[k + 1], &starts, scale)
        };
        let rivals: Vec<Vec<Rival>> = self.members.par_iter().enumerate().map(rival).collect();
        if self.take_better(rivals, check, options.min_margin)? {
            refine_together(&mut self.placed, upright, scale);
        }
        for (member, refined) in self.members.iter_mut().zip(&self.placed[1..]) {
            let hypothesis = &mut member.decision.hypothesis;
            hypothesis.pose = refined.pose;
            let pair = ObjectPair { reference: self.reference, target: member.surface };
            hypothesis.fit = fit_at(pair, &refined.pose, BASE);
        }
        let costs: Vec<f64> = self.members.iter().map(|m| m.decision.hypothesis.fit.cost).collect();
        let RegisterOptions { min_margin, seed, .. } = *options;
        Ok(uncertainties(&self.placed, &costs, Spread { axis: upright, allow_scale: scale, min_margin, seed }))
    }

    /// Replaces poses by rivals that fit better by surface, colours and pictures together, and marks those as ambiguous
    /// whose rivals fit about as well. Of several rivals of a member the best by all of these counts: by its surface alone
    /// another may look better. True if any pose was replaced.
    fn take_better(
        &mut self,
        rivals: Vec<Vec<Rival>>,
        mut check: Option<&mut (dyn PoseCheck + '_)>,
        min_margin: f64,
    ) -> Result<bool, RegisterError> {
        let (mut any, count) = (false, self.members.len());
        for ((member, place), rivals) in self.members.iter_mut().zip(&mut self.placed[1..]).zip(rivals) {
            let pair = ObjectPair { reference: self.reference, target: member.surface };
            let judged = rivals.into_iter().map(|rival| judge(check.as_deref_mut(), pair, &place.pose, rival));
            let mut judged = judged.collect::<Result<Vec<Judged>, RegisterError>>()?;
            judged.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
            let Some(&Judged { pose, ratio, agreement }) = judged.first() else { continue };
            let decision = &mut member.decision;
            // A doubt of before is of the reference alone; enough others are better evidence.
            let settles = count >= ENOUGH && matches!(decision.certainty, Certainty::Ambiguous(_));
            if ratio * (1.0 + min_margin) < 1.0 {
                (place.pose, any) = (pose, true);
                decision.agreement = agreement.or(decision.agreement);
                if settles {
                    decision.certainty = Certainty::Certain;
                }
                // Several rivals may have come to one pose.
                let others = judged[1..].iter().filter(|other| other.pose.angle_to(&pose) > SAME_POSE);
                if let Some(next) = others.min_by(|a, b| a.ratio.total_cmp(&b.ratio))
                    && next.ratio < ratio * (1.0 + min_margin)
                {
                    doubt(self.reference, decision, &pose.inverse().after(&next.pose), next.ratio / ratio - 1.0);
                }
            } else if ratio < 1.0 + min_margin {
                doubt(self.reference, decision, &place.pose.inverse().after(&pose), ratio - 1.0);
            } else if settles {
                decision.certainty = Certainty::Certain;
            }
        }
        Ok(any)
    }
}

/// A rival pose of a member, compared with the present one.
#[derive(Clone, Copy)]
struct Judged {
    pose: Pose,
    /// Badness relative to the present pose; see [`doubt_ratio`].
    ratio: f64,
    /// Agreement with the pictures, if they were compared.
    agreement: Option<Agreement>,
}

/// Compares a rival with the `present` pose by colours and, if these leave it in the running, by pictures.
fn judge(
    check: Option<&mut (dyn PoseCheck + '_)>,
    pair: ObjectPair<'_>,
    present: &Pose,
    rival: Rival,
) -> Result<Judged, RegisterError> {
    let poses = [*present, rival.pose];
    let colors = poses.map(|pose| unexplained_color(pair.reference, pair.target, &pose));
    let ratio = doubt_ratio(rival.surface, colors, None);
    let seen = if ratio < WORTH_PICTURES { pictures(check, pair, poses)? } else { None };
    let ratio = doubt_ratio(ratio, [0.0; 2], seen);
    Ok(Judged { pose: rival.pose, ratio, agreement: seen.map(|[_, rival]| rival) })
}

/// Agreement of pictures for two poses of (reference, target); `None` if no view shows the target.
fn pictures(
    check: Option<&mut (dyn PoseCheck + '_)>,
    pair: ObjectPair<'_>,
    poses: [Pose; 2],
) -> Result<Option<[Agreement; 2]>, RegisterError> {
    let Some(check) = check else { return Ok(None) };
    let ObjectPair { reference, target } = pair;
    let poses = poses.map(|pose| target_from_reference(reference, target, &pose));
    let seen = check.check(reference.id, target.id, &poses)?;
    Ok(seen.and_then(|seen| seen.try_into().ok()))
}

/// Uncertainty of each member but the reference; `costs` are those of their fit to the reference.
fn uncertainties(all: &[Member<'_>], costs: &[f64], spread: Spread) -> Vec<Option<PoseUncertainty>> {
    let median = {
        let mut sorted = costs.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
    };
    let costs: Vec<f64> = std::iter::once(median).chain(costs.iter().copied()).collect();
    let all = spread.of_all(all, &costs);
    // Of two objects there is only one relative pose, whose uncertainty already has both parts.
    let of_reference = if all.len() > 2 { all[0] } else { None };
    all[1..].iter().map(|own| own.map(|own| of_reference.map_or(own, |reference| own.and(reference)))).collect()
}

/// Marks a pose as symmetric or ambiguous, because the object fits about as well after `motion`.
fn doubt(reference: &ObjectSurface, decision: &mut Decision, motion: &Pose, lead: f64) {
    if decision.certainty == Certainty::Certain {
        let symmetric = is_symmetry(reference, motion, decision.hypothesis.fit.cost);
        decision.certainty = if symmetric { Certainty::Symmetric(2) } else { Certainty::Ambiguous(lead.max(0.0)) };
    }
}
