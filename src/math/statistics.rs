//! Order statistics of small sets of measurements.

/// Median and 10th and 90th percentile, in the unit of the values.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Percentiles {
    /// The 50th percentile.
    pub median: f64,
    /// The 10th percentile.
    pub p10: f64,
    /// The 90th percentile.
    pub p90: f64,
}

impl Percentiles {
    /// The percentiles of values in any order; zeros if there are none.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self { median: interpolated(&sorted, 0.5), p10: interpolated(&sorted, 0.1), p90: interpolated(&sorted, 0.9) }
    }
}

/// The median of values in any order; 0 if there are none. Without sorting: a scene has millions of points.
pub fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let (_, &mut low, above) = values.select_nth_unstable_by(last / 2, f64::total_cmp);
    if last.is_multiple_of(2) {
        return low;
    }
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    low + (high - low) * 0.5
}

/// The value below which `fraction` (0..=1) of the values lies, interpolated between the two nearest ranks; 0 if there
/// are none. Values may be in any order.
pub fn percentile(values: &[f64], fraction: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    interpolated(&sorted, fraction)
}

/// Interpolates between the two nearest ranks of sorted values.
fn interpolated(sorted: &[f64], fraction: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let position = fraction * last as f64;
    let (low, high) = (sorted[position.floor() as usize], sorted[position.ceil() as usize]);
    low + (high - low) * position.fract()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_hand() {
        assert_eq!(Percentiles::of(&[]), Percentiles::default());
        assert_eq!(Percentiles::of(&[3.0]), Percentiles { median: 3.0, p10: 3.0, p90: 3.0 });
        let values: Vec<f64> = (0..=10).rev().map(f64::from).collect();
        assert_eq!(Percentiles::of(&values), Percentiles { median: 5.0, p10: 1.0, p90: 9.0 });
        assert_eq!((median(&[]), median(&[3.0]), median(&[1.0, 2.0])), (0.0, 3.0, 1.5));
        let mut some = Vec::new();
        for i in 0..40 {
            some.push(f64::from(i * 17 % 23));
            assert_eq!(median(&some), Percentiles::of(&some).median, "{i}");
        }
        assert!((percentile(&values, 0.99) - 9.9).abs() < 1e-12);
    }
}
