//! Chooses among the poses of a target and states how certain the choice is.

use super::check::Agreement;
use super::hypotheses::{Hypothesis, ObjectPair, fit_at};
use super::options::RegisterOptions;
use super::pose::Pose;
use super::sample::{BASE, ObjectSurface};

/// Differences of unexplained colour below this are noise, 0..=1.
const COLOR_FLOOR: f64 = 0.3;
/// The same for the photometric difference: two grey levels of 255.
const PHOTOMETRIC_FLOOR: f64 = 0.01;
/// The same for the silhouette: a fiftieth of the outline.
const SILHOUETTE_FLOOR: f64 = 0.02;

/// A motion of the reference onto itself is a symmetry if its cost is at most this many times the cost of the reference
/// on the target.
const SYMMETRIC: f64 = 1.1;

/// Certainty of a chosen pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Certainty {
    /// No other pose comes near.
    Certain,
    /// Others fit as well because the object is symmetric; the number of equivalent poses.
    Symmetric(usize),
    /// Another pose is about as likely; the part by which it is worse.
    Ambiguous(f64),
}

/// The chosen pose of a target.
#[derive(Clone, Debug)]
pub(super) struct Decision {
    /// Pose, fit and colour agreement.
    pub hypothesis: Hypothesis,
    /// Agreement of pictures, if they were compared.
    pub agreement: Option<Agreement>,
    /// Certainty of the choice.
    pub certainty: Certainty,
    /// Other poses that are about as likely and no symmetries.
    pub rivals: Vec<Pose>,
}

/// Chooses among at least one hypothesis; `agreements`, if given, is in the same order. The badness of a pose is the
/// product of its cost and its colour and picture differences, each relative to the smallest. `None` without
/// hypotheses.
pub(super) fn decide(
    reference: &ObjectSurface,
    hypotheses: &[Hypothesis],
    agreements: Option<&[Agreement]>,
    options: &RegisterOptions,
) -> Option<Decision> {
    let relative = |of: &dyn Fn(usize) -> f64, floor: f64| -> Vec<f64> {
        let values: Vec<f64> = (0..hypotheses.len()).map(|i| of(i) + floor).collect();
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        values.into_iter().map(|v| v / least).collect()
    };
    let mut doubts = relative(&|i| hypotheses[i].fit.cost, 0.0);
    let mut count_in = |parts: Vec<f64>| doubts.iter_mut().zip(parts).for_each(|(doubt, part)| *doubt *= part);
    count_in(relative(&|i| hypotheses[i].color, COLOR_FLOOR));
    if let Some(agreements) = agreements.filter(|a| a.len() == hypotheses.len()) {
        count_in(relative(&|i| agreements[i].photometric, PHOTOMETRIC_FLOOR));
        count_in(relative(&|i| agreements[i].silhouette, SILHOUETTE_FLOOR));
    }
    let mut order: Vec<usize> = (0..hypotheses.len()).collect();
    order.sort_by(|&a, &b| doubts[a].total_cmp(&doubts[b]).then(a.cmp(&b)));
    let &best = order.first()?;
    let rivals: Vec<usize> =
        order[1..].iter().copied().filter(|&i| doubts[i] <= (1.0 + options.min_margin) * doubts[best]).collect();
    let chosen = hypotheses[best];
    // In a symmetric object both poses fit the surface equally well; otherwise only colours compensate a worse fit.
    let as_well = |i: usize| {
        let costs = hypotheses[i].fit.cost / chosen.fit.cost;
        costs.max(1.0 / costs) <= 1.0 + 2.0 * options.min_margin
    };
    let symmetric = |i: usize| {
        as_well(i) && is_symmetry(reference, &chosen.pose.inverse().after(&hypotheses[i].pose), chosen.fit.cost)
    };
    let others: Vec<usize> = rivals.iter().copied().filter(|&i| !symmetric(i)).collect();
    let certainty = match (rivals.is_empty(), others.first()) {
        (true, _) => Certainty::Certain,
        (false, None) => Certainty::Symmetric(1 + rivals.len()),
        (false, Some(&rival)) => Certainty::Ambiguous(doubts[rival] / doubts[best] - 1.0),
    };
    let agreement = agreements.and_then(|a| a.get(best)).copied();
    let rivals = others.into_iter().map(|i| hypotheses[i].pose).collect();
    Some(Decision { hypothesis: chosen, agreement, certainty, rivals })
}

/// Badness of the second of two poses relative to the first: the ratio of their surface costs times those of
/// unexplained colour and of the pictures' differences. Below 1 the second is better.
pub(super) fn doubt_ratio(surfaces: f64, colors: [f64; 2], seen: Option<[Agreement; 2]>) -> f64 {
    let ratio = |[first, second]: [f64; 2], floor: f64| (second + floor) / (first + floor);
    let pictures = seen.map_or(1.0, |seen| {
        let photometric = ratio(seen.map(|s| s.photometric), PHOTOMETRIC_FLOOR);
        photometric * ratio(seen.map(|s| s.silhouette), SILHOUETTE_FLOOR)
    });
    surfaces * ratio(colors, COLOR_FLOOR) * pictures
}

/// Whether the motion maps the reference onto itself about as well as it fits the target, whose cost is `cost`.
pub(super) fn is_symmetry(reference: &ObjectSurface, motion: &Pose, cost: f64) -> bool {
    fit_at(ObjectPair { reference, target: reference }, motion, BASE).cost <= SYMMETRIC * cost
}
