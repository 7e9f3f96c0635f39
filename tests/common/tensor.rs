//! Comparison of whole tensors, gradients above all: the relative L2 error, which large entries dominate as they do in
//! an optimiser, and the worst entry, to look at.

/// Two tensors of equal length.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TensorComparison {
    /// What is compared, for messages.
    pub(crate) name: String,
    /// |got - want| / |want|, Euclidean norms; 0 for equal tensors, infinite if only `want` is zero.
    pub(crate) relative_l2: f64,
    /// Flat index of the entry with the largest absolute difference, its value, and what it should be.
    pub(crate) worst: (usize, f64, f64),
    /// Entries of `got` or `want` that are not finite; the numbers above are over the others.
    pub(crate) non_finite: usize,
}

impl TensorComparison {
    /// Compares `got` with `want`.
    pub(crate) fn new(name: &str, got: &[f64], want: &[f64]) -> Self {
        assert_eq!(got.len(), want.len(), "{name}: lengths");
        let mut out = Self { name: name.into(), relative_l2: 0.0, worst: (0, 0.0, 0.0), non_finite: 0 };
        let (mut error2, mut norm2, mut largest) = (0.0, 0.0, -1.0);
        for (index, (&g, &w)) in got.iter().zip(want).enumerate() {
            if !(g.is_finite() && w.is_finite()) {
                out.non_finite += 1;
                continue;
            }
            let error = (g - w).abs();
            error2 += error * error;
            norm2 += w * w;
            if error > largest {
                largest = error;
                out.worst = (index, g, w);
            }
        }
        out.relative_l2 = if error2 == 0.0 { 0.0 } else { (error2 / norm2).sqrt() };
        out
    }

    /// The error names the tensor and its worst entry.
    pub(crate) fn check(&self, tolerance: f64) -> Result<(), String> {
        let Self { name, relative_l2, worst: (index, got, want), non_finite } = self;
        if *non_finite > 0 {
            return Err(format!("{name}: {non_finite} entries are not finite"));
        }
        if *relative_l2 > tolerance {
            return Err(format!(
                "{name}: relative L2 error {relative_l2:.3e} > {tolerance:.1e}, worst entry {index}: {got:e} instead of {want:e}"
            ));
        }
        Ok(())
    }
}

mod tests {
    use super::*;

    fn check(got: &[f64], want: &[f64], tolerance: f64) -> Result<(), String> {
        TensorComparison::new("t", got, want).check(tolerance)
    }

    #[test]
    fn equal_tensors_pass() {
        assert_eq!(check(&[1.0, -2.0], &[1.0, -2.0], 0.0), Ok(()));
        assert_eq!(check(&[0.0; 3], &[0.0; 3], 0.0), Ok(()));
        assert_eq!(check(&[], &[], 0.0), Ok(()));
    }

    #[test]
    fn one_wrong_entry_fails_and_is_named() {
        let want: Vec<f64> = (0..100).map(|i| f64::from(i) - 50.0).collect();
        let mut got = want.clone();
        got[7] += 1.0;
        let comparison = TensorComparison::new("t", &got, &want);
        assert_eq!(comparison.worst, (7, -42.0, -43.0));
        assert!((comparison.relative_l2 - 1.0 / 83350f64.sqrt()).abs() < 1e-15, "{}", comparison.relative_l2);
        assert!(comparison.check(1e-3).unwrap_err().contains("worst entry 7"));
        assert_eq!(comparison.check(4e-3), Ok(()));
    }

    #[test]
    fn scale_sign_order_and_poison_fail() {
        let want = [3.0, -4.0, 12.0];
        assert!(check(&want.map(|v| 1.01 * v), &want, 9e-3).is_err(), "scale");
        assert!(check(&want.map(|v| -v), &want, 1.9).is_err(), "sign");
        assert!(check(&[3.0, 12.0, -4.0], &want, 1.0).is_err(), "order");
        assert!(check(&[0.0; 3], &want, 0.99).is_err(), "nothing at all");
        assert!(check(&[1e-30, 0.0], &[0.0; 2], 1e300).is_err(), "something where there is nothing");
        for bad in [f64::NAN, f64::INFINITY] {
            assert!(check(&[3.0, bad, 12.0], &want, 1e300).unwrap_err().contains("finite"));
            assert!(check(&want, &[3.0, bad, 12.0], 1e300).is_err());
        }
    }
}
