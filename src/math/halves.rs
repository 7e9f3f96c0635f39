//! The two halves of a Gaussian: what densification replaces it by, and what two Gaussians of a template begin as that stand for one.

/// What the halves of a Gaussian are like beside it. They lie along its longest axis, on either side of its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Halves {
    /// Divisor of the longest axis.
    pub shrink: f64,
    /// Opacity of each, times that of the whole.
    pub opacity: f64,
}

impl Halves {
    /// Distance of each from the centre, in standard deviations along the longest axis of the whole: the two then have its variance
    /// along that axis.
    #[must_use]
    pub fn distance(&self) -> f64 {
        (1.0 - self.shrink.powi(-2)).sqrt()
    }
}

impl Default for Halves {
    /// The defaults of `densify.split_shrink` and `densify.half_opacity`.
    fn default() -> Self {
        Self { shrink: 1.6, opacity: 0.6 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_halves_have_the_variance_of_the_whole() {
        for shrink in [1.2, 1.6, 4.0] {
            let halves = Halves { shrink, ..Halves::default() };
            // Of two normal distributions of variance 1 / shrink^2 around plus and minus the distance.
            let variance = shrink.powi(-2) + halves.distance().powi(2);
            assert!((variance - 1.0f64).abs() < 1e-12, "{shrink}: {variance}");
        }
    }
}
