//! Quick tests of whether two objects can belong to one group.

use super::hypotheses::Hypothesis;
use super::options::RegisterOptions;
use super::sample::ObjectSurface;

/// Largest ratio of sizes of objects with the same name: some lack parts, or were seen in part.
const SIZE_FACTOR: f64 = 2.0;
/// Edges of the boxes of objects without a name may differ by at most this part of their size.
const MOST_UNLIKE: f64 = 0.2;
/// Why two objects are not alike.
pub(super) struct Unlike {
    /// Part of their surfaces that agrees, 0..=1; 0 if they were not registered.
    pub agree: f64,
    /// The reason in words, for the report.
    pub reason: String,
}

impl Unlike {
    /// Rejected before registration.
    pub(super) fn at_once(reason: impl Into<String>) -> Self {
        Self { agree: 0.0, reason: reason.into() }
    }
}

/// Rejects pairs of objects whose size or shape differs too much for registration.
pub(super) fn check_shape(
    reference: &ObjectSurface,
    target: &ObjectSurface,
    named: bool,
    options: &RegisterOptions,
) -> Result<(), Unlike> {
    let ratio = target.size / reference.size;
    if !options.allow_scale && !(1.0 / SIZE_FACTOR..=SIZE_FACTOR).contains(&ratio) {
        return Err(Unlike::at_once(format!("{ratio:.2} times as large as object {}", reference.id)));
    }
    let scale = if options.allow_scale { ratio } else { 1.0 };
    let difference = (target.extents - reference.extents * scale).abs().max_element();
    if !named && difference > MOST_UNLIKE * target.size {
        return Err(Unlike::at_once(format!("of another shape than object {}", reference.id)));
    }
    Ok(())
}

/// Keeps the poses that fit well enough, or returns how much of the two surfaces agrees at most.
pub(super) fn check_fit(
    found: Vec<Hypothesis>,
    reference: u32,
    options: &RegisterOptions,
) -> Result<Vec<Hypothesis>, Unlike> {
    let Some(best) = found.first().map(|best| best.fit) else { return Err(Unlike::at_once("has no points")) };
    let agree = |h: &Hypothesis| h.fit.inliers >= options.min_inliers && h.fit.covered >= 0.5 * options.min_inliers;
    let fitting: Vec<Hypothesis> = found.into_iter().filter(agree).collect();
    if fitting.is_empty() {
        let agree = best.inliers.min(best.covered);
        let reason = format!("unlike object {reference}: only {:.0} % of their surfaces agree", 100.0 * agree);
        return Err(Unlike { agree, reason });
    }
    Ok(fitting)
}
