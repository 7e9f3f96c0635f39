//! Whether two objects may be of one kind.

use super::hypotheses::Hypothesis;
use super::options::RegisterOptions;
use super::sample::ObjectSurface;

/// Objects of one name have sizes within this factor: some lack parts, or were seen in part.
const SIZE_FACTOR: f64 = 2.0;
/// Edges of the boxes of objects without a name differ by at most this part of their size, or they are not tried.
const MOST_UNLIKE: f64 = 0.2;
/// Whether it is worth a try.
pub(super) fn check_shape(
    reference: &ObjectSurface,
    target: &ObjectSurface,
    named: bool,
    options: &RegisterOptions,
) -> Result<(), String> {
    let ratio = target.size / reference.size;
    if !options.allow_scale && !(1.0 / SIZE_FACTOR..=SIZE_FACTOR).contains(&ratio) {
        return Err(format!("{ratio:.2} times as large as object {}", reference.id));
    }
    let scale = if options.allow_scale { ratio } else { 1.0 };
    let difference = (target.extents - reference.extents * scale).abs().max_element();
    if !named && difference > MOST_UNLIKE * target.size {
        return Err(format!("of another shape than object {}", reference.id));
    }
    Ok(())
}

/// Whether the best pose makes them one kind.
pub(super) fn check_fit(found: &[Hypothesis], reference: u32, options: &RegisterOptions) -> Result<(), String> {
    let Some(best) = found.first() else { return Err("has no points".into()) };
    let Hypothesis { fit, .. } = best;
    if fit.inliers < options.min_inliers || fit.covered < 0.5 * options.min_inliers {
        let part = 100.0 * fit.inliers.min(fit.covered);
        return Err(format!("unlike object {reference}: only {part:.0} % of their surfaces agree"));
    }
    Ok(())
}
