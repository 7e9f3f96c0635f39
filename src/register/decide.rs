//! Which of several poses it is, and how sure that is.

use super::check::Agreement;
use super::hypotheses::{Hypothesis, ObjectPair, fit_at};
use super::options::RegisterOptions;
use super::pose::Pose;
use super::sample::{BASE, ObjectSurface};

/// Below this, differences of unexplained colour say nothing, 0..=1.
const COLOR_FLOOR: f64 = 0.3;
/// The same for pictures: two grey levels of 255, and a fiftieth of the outline.
const PHOTOMETRIC_FLOOR: f64 = 0.01;
const SILHOUETTE_FLOOR: f64 = 0.02;

/// A motion that brings the reference onto itself with at most this many times the cost of its lying on the target is a
/// symmetry.
const SYMMETRIC: f64 = 1.1;

/// How sure a pose is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Certainty {
    /// No other comes near.
    Certain,
    /// Others are as good because the object is symmetric: so many are right.
    Symmetric(usize),
    /// Another is as good: by this part worse.
    Ambiguous(f64),
}

/// The pose of a target.
#[derive(Clone, Debug)]
pub(super) struct Decision {
    /// The chosen one.
    pub hypothesis: Hypothesis,
    /// Colours in pictures, if there was a check.
    pub agreement: Option<Agreement>,
    /// How sure it is.
    pub certainty: Certainty,
    /// Other poses that are as good, though the object is not symmetric.
    pub rivals: Vec<Pose>,
}

/// Chooses among hypotheses (at least one), of which `agreements` (if any) says how pictures see them, in the same order. What speaks against a
/// pose is multiplied: each part relative to the least of all.
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
    // A symmetric object lies as well one way as the other; if it does not, colours only made up for it.
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

/// What speaks against the second of two poses, per what speaks against the first: the ratio of how surfaces fit, times
/// those of unexplained colour and of what pictures say. Below 1 the second is better.
pub(super) fn doubt_ratio(surfaces: f64, colors: [f64; 2], seen: Option<[Agreement; 2]>) -> f64 {
    let ratio = |[first, second]: [f64; 2], floor: f64| (second + floor) / (first + floor);
    let pictures = seen.map_or(1.0, |seen| {
        let photometric = ratio(seen.map(|s| s.photometric), PHOTOMETRIC_FLOOR);
        photometric * ratio(seen.map(|s| s.silhouette), SILHOUETTE_FLOOR)
    });
    surfaces * ratio(colors, COLOR_FLOOR) * pictures
}

/// True if the motion brings the reference onto itself, as well as it lies on the target.
pub(super) fn is_symmetry(reference: &ObjectSurface, motion: &Pose, cost: f64) -> bool {
    fit_at(ObjectPair { reference, target: reference }, motion, BASE).cost <= SYMMETRIC * cost
}
