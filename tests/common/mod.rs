//! Shared by the integration tests: golden files, random scenes, and the comparators of images and tensors.
#![allow(dead_code, reason = "every test binary uses a part of it")]

pub(crate) mod chairs;
pub(crate) mod crash;
pub(crate) mod dataset;
pub(crate) mod golden;
pub(crate) mod gpu;
pub(crate) mod gpu_gradients;
pub(crate) mod program;
pub(crate) mod random_scene;
pub(crate) mod scale;
pub(crate) mod scramble;
pub(crate) mod tensor;

pub(crate) use program::repository;

/// At most this fraction of an image's pixels may be excluded as not robust (docs/design.md).
pub(crate) const MAX_EXCLUDED_FRACTION: f64 = 0.02;

/// The difference of two images of equal size with any number of channels, over robust pixels.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ImageComparison {
    /// Largest absolute difference of a robust pixel.
    pub(crate) max_abs_error: f64,
    /// Where it is: pixel index (row major) and channel.
    pub(crate) worst: (usize, usize),
    /// Values, in any pixel of either image, that are not finite.
    pub(crate) non_finite: usize,
    /// Pixels that are not robust, as a fraction of all.
    pub(crate) excluded_fraction: f64,
}

impl ImageComparison {
    /// Compares `[pixel][channel]` arrays; `robust` has one entry per pixel.
    pub(crate) fn new<const C: usize>(got: &[[f64; C]], want: &[[f64; C]], robust: &[bool]) -> Self {
        assert_eq!((got.len(), want.len()), (robust.len(), robust.len()), "images and mask have the same size");
        let mut out = Self { max_abs_error: 0.0, worst: (0, 0), non_finite: 0, excluded_fraction: 0.0 };
        let excluded = robust.iter().filter(|&&r| !r).count();
        out.excluded_fraction = excluded as f64 / robust.len().max(1) as f64;
        for (pixel, (g, w)) in got.iter().zip(want).enumerate() {
            for channel in 0..C {
                if !(g[channel].is_finite() && w[channel].is_finite()) {
                    out.non_finite += 1;
                    continue;
                }
                let error = (g[channel] - w[channel]).abs();
                if robust[pixel] && error > out.max_abs_error {
                    out.max_abs_error = error;
                    out.worst = (pixel, channel);
                }
            }
        }
        out
    }

    /// The error says which of the three rules is broken: all values finite, few pixels excluded, errors small.
    pub(crate) fn check(&self, tolerance: f64) -> Result<(), String> {
        if self.non_finite > 0 {
            return Err(format!("{} values are not finite", self.non_finite));
        }
        if self.excluded_fraction > MAX_EXCLUDED_FRACTION {
            return Err(format!("{:.2} % of the pixels are excluded", 100.0 * self.excluded_fraction));
        }
        if self.max_abs_error > tolerance {
            let (pixel, channel) = self.worst;
            return Err(format!(
                "error {:.3e} > {tolerance:.1e} at pixel {pixel}, channel {channel}",
                self.max_abs_error
            ));
        }
        Ok(())
    }
}

/// One-channel data in the form the comparator takes.
pub(crate) fn single_channel(values: &[f64]) -> Vec<[f64; 1]> {
    values.iter().map(|&v| [v]).collect()
}

/// Both masks at once: pixels that either side calls fragile are excluded.
pub(crate) fn both_robust(a: &[bool], b: &[bool]) -> Vec<bool> {
    a.iter().zip(b).map(|(&a, &b)| a && b).collect()
}

mod tests {
    use super::*;

    /// A 10x10 image of noise-free values, all robust.
    fn image() -> (Vec<[f64; 3]>, Vec<bool>) {
        ((0..100).map(|i| [f64::from(i) / 100.0, 0.5, 0.0]).collect(), vec![true; 100])
    }

    #[test]
    fn equal_images_pass() {
        let (image, robust) = image();
        let comparison = ImageComparison::new(&image, &image, &robust);
        assert_eq!((comparison.max_abs_error, comparison.excluded_fraction), (0.0, 0.0));
        assert_eq!(comparison.check(0.0), Ok(()));
    }

    #[test]
    fn one_wrong_pixel_fails_unless_it_is_excluded() {
        let (want, mut robust) = image();
        let mut got = want.clone();
        got[37][2] += 2e-4;
        let comparison = ImageComparison::new(&got, &want, &robust);
        assert_eq!(comparison.worst, (37, 2));
        assert!(comparison.check(1e-4).unwrap_err().contains("pixel 37, channel 2"));
        assert_eq!(comparison.check(3e-4), Ok(()));
        robust[37] = false;
        assert_eq!(ImageComparison::new(&got, &want, &robust).check(1e-4), Ok(()));
    }

    #[test]
    fn too_many_excluded_pixels_fail() {
        let (image, mut robust) = image();
        robust[..2].fill(false);
        assert_eq!(ImageComparison::new(&image, &image, &robust).check(1e-4), Ok(()));
        robust[..3].fill(false);
        assert!(ImageComparison::new(&image, &image, &robust).check(1e-4).unwrap_err().contains("excluded"));
    }

    #[test]
    fn nan_and_infinity_fail_even_where_excluded() {
        for bad in [f64::NAN, f64::INFINITY] {
            let (want, mut robust) = image();
            let mut got = want.clone();
            got[5][1] = bad;
            assert!(ImageComparison::new(&got, &want, &robust).check(1e-4).unwrap_err().contains("finite"));
            robust[5] = false;
            assert!(ImageComparison::new(&got, &want, &robust).check(1e-4).is_err());
        }
    }
}
