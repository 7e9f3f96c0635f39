//! The members of a group, once each has a pose against the reference.

use glam::DVec3;
use rayon::prelude::*;

use super::decide::{Certainty, Decision, is_symmetry};
use super::hypotheses::fit_at;
use super::options::RegisterOptions;
use super::pose::Pose;
use super::sample::{BASE, ObjectSurface};
use super::together::{Member, best_rival, half_turned, refine_together};

/// From so many members on, all others together say more than the reference alone had.
const ENOUGH: usize = 3;

/// A member and its pose against the reference.
pub(super) struct Aligned<'a> {
    /// The member.
    pub surface: &'a ObjectSurface,
    /// Its pose.
    pub decision: Decision,
}

/// Lays the members on each other, and gives those another pose that fit better so.
pub(super) fn settle(
    reference: &ObjectSurface,
    members: &mut [Aligned<'_>],
    up: Option<DVec3>,
    options: &RegisterOptions,
) {
    let (scale, count) = (options.allow_scale, members.len());
    let mut all = vec![Member { surface: reference, pose: Pose::IDENTITY }];
    all.extend(members.iter().map(|m| Member { surface: m.surface, pose: m.decision.hypothesis.pose }));
    refine_together(&mut all, up, scale);
    let rival = |(k, member): (usize, &Aligned<'_>)| {
        let turned = up.map(|up| half_turned(&all[k + 1].pose, up));
        let starts: Vec<Pose> = member.decision.rivals.iter().copied().chain(turned).collect();
        best_rival(&all, k + 1, &starts, scale)
    };
    let rivals: Vec<Option<(Pose, f64)>> = members.par_iter().enumerate().map(rival).collect();
    let mut any = false;
    for ((member, place), rival) in members.iter_mut().zip(&mut all[1..]).zip(rivals) {
        let Some((pose, ratio)) = rival else { continue };
        if ratio * (1.0 + options.min_margin) < 1.0 {
            (place.pose, any) = (pose, true);
        } else if ratio < 1.0 + options.min_margin {
            doubt(reference, &mut member.decision, &place.pose.inverse().after(&pose), ratio - 1.0);
        } else if count >= ENOUGH && matches!(member.decision.certainty, Certainty::Ambiguous(_)) {
            member.decision.certainty = Certainty::Certain;
        }
    }
    if any {
        refine_together(&mut all, up, scale);
    }
    for (member, refined) in members.iter_mut().zip(&all[1..]) {
        let hypothesis = &mut member.decision.hypothesis;
        hypothesis.pose = refined.pose;
        hypothesis.fit = fit_at((reference, member.surface), &refined.pose, BASE);
    }
}

/// Puts a pose in doubt, because the object fits about as well after a motion; unless pictures had decided.
fn doubt(reference: &ObjectSurface, decision: &mut Decision, motion: &Pose, lead: f64) {
    if decision.certainty == Certainty::Certain && decision.agreement.is_none() {
        let symmetric = is_symmetry(reference, motion, decision.hypothesis.fit.cost);
        decision.certainty = if symmetric { Certainty::Symmetric(2) } else { Certainty::Ambiguous(lead.max(0.0)) };
    }
}
