//! Whether two objects may be of one kind.

use super::hypotheses::Hypothesis;
use super::options::RegisterOptions;
use super::sample::ObjectSurface;

/// Objects of one name have sizes within this factor: some lack parts, or were seen in part.
const SIZE_FACTOR: f64 = 2.0;
/// Edges of the boxes of objects without a name differ by at most this part of their size, or they are not tried.
const MOST_UNLIKE: f64 = 0.2;
/// Why two objects are not of one kind.
pub(super) struct Unlike {
    /// Part of their surfaces that agrees, 0..=1; 0 if that was not tried.
    pub agree: f64,
    /// In words.
    pub reason: String,
}

impl Unlike {
    /// Without a try.
    pub(super) fn at_once(reason: impl Into<String>) -> Self {
        Self { agree: 0.0, reason: reason.into() }
    }
}

/// Whether it is worth a try.
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

/// Leaves the poses that make them one kind, or says how little of the two agrees.
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
