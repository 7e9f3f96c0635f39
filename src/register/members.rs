//! The members of a group, once each has a pose against the reference.

use glam::DVec3;
use rayon::prelude::*;

use super::decide::{Certainty, Decision, is_symmetry};
use super::hypotheses::fit_at;
use super::options::RegisterOptions;
use super::pose::Pose;
use super::sample::{BASE, ObjectSurface};
use super::spread::{PoseUncertainty, Spread};
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

/// Lays the members on each other, and gives those another pose that fit better so. Says how sure each pose against the
/// reference is.
pub(super) fn settle(
    reference: &ObjectSurface,
    members: &mut [Aligned<'_>],
    up: Option<DVec3>,
    options: &RegisterOptions,
) -> Vec<Option<PoseUncertainty>> {
    let (scale, count) = (options.allow_scale, members.len());
    let mut all = vec![Member { surface: reference, pose: Pose::IDENTITY }];
    all.extend(members.iter().map(|m| Member { surface: m.surface, pose: m.decision.hypothesis.pose }));
    let mut axis = refine_together(&mut all, up, scale);
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
        axis = refine_together(&mut all, up, scale);
    }
    for (member, refined) in members.iter_mut().zip(&all[1..]) {
        let hypothesis = &mut member.decision.hypothesis;
        hypothesis.pose = refined.pose;
        hypothesis.fit = fit_at((reference, member.surface), &refined.pose, BASE);
    }
    let costs: Vec<f64> = members.iter().map(|m| m.decision.hypothesis.fit.cost).collect();
    let RegisterOptions { min_margin, seed, .. } = *options;
    uncertainties(&all, &costs, Spread { axis, allow_scale: scale, min_margin, seed })
}

/// By member besides the reference, the first; `costs` are those of their lying on it.
fn uncertainties(all: &[Member<'_>], costs: &[f64], spread: Spread) -> Vec<Option<PoseUncertainty>> {
    let median = {
        let mut sorted = costs.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
    };
    // Of two objects there is but one pose: what is said of the other says it all.
    let of_reference = (costs.len() > 1).then(|| spread.of(all, 0, median)).flatten();
    let of = |(i, &cost): (usize, &f64)| {
        let own = spread.of(all, i + 1, cost)?;
        Some(of_reference.map_or(own, |reference| own.and(reference)))
    };
    costs.par_iter().enumerate().map(of).collect()
}

/// Puts a pose in doubt, because the object fits about as well after a motion; unless pictures had decided.
fn doubt(reference: &ObjectSurface, decision: &mut Decision, motion: &Pose, lead: f64) {
    if decision.certainty == Certainty::Certain && decision.agreement.is_none() {
        let symmetric = is_symmetry(reference, motion, decision.hypothesis.fit.cost);
        decision.certainty = if symmetric { Certainty::Symmetric(2) } else { Certainty::Ambiguous(lead.max(0.0)) };
    }
}
