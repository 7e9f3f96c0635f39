//! Peak signal-to-noise ratio.

use crate::pair::PicturePair;

/// Upper limit of reported values, dB: beyond it (a mean squared error of 1e-10) only f32 rounding is left, and
/// identical pictures would have an infinite PSNR, which JSON cannot represent.
pub const MAX_PSNR_DB: f64 = 100.0;

/// `-10 log10(MSE)` in dB, with the mean over the three channels of the pixels that count; at most [`MAX_PSNR_DB`].
pub fn psnr(pair: &PicturePair) -> f64 {
    let squares =
        |(a, b): (&[f32; 3], &[f32; 3])| -> f64 { (0..3).map(|c| (f64::from(a[c]) - f64::from(b[c])).powi(2)).sum() };
    // Masked pixels are equal in both pictures and add nothing.
    let sum: f64 = pair.render().iter().zip(pair.target()).map(squares).sum();
    let mse = sum / (3 * pair.valid_pixels()) as f64;
    (-10.0 * mse.log10()).min(MAX_PSNR_DB)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::PairError;

    #[test]
    fn of_constant_differences_masks_and_equality() -> Result<(), PairError> {
        let target = [[0.5f32; 3]; 4];
        let mut render = [[0.25f32; 3]; 4];
        let quarter = psnr(&PicturePair::new((2, 2), &render, &target, None)?);
        assert!((quarter - 40.0 * 2f64.log10()).abs() < 1e-12, "{quarter}");
        // Half of the pixels count, and those differ as before: masked pixels must not dilute the mean.
        render[0] = [1.0; 3];
        render[1] = [1.0; 3];
        let mask = [false, false, true, true];
        assert_eq!(psnr(&PicturePair::new((2, 2), &render, &target, Some(&mask))?), quarter);
        assert_ne!(psnr(&PicturePair::new((2, 2), &render, &target, None)?), quarter);
        assert_eq!(psnr(&PicturePair::new((2, 2), &target, &target, None)?), MAX_PSNR_DB);
        let nearly = target.map(|rgb| rgb.map(|v| v + 1e-6));
        assert_eq!(psnr(&PicturePair::new((2, 2), &nearly, &target, None)?), MAX_PSNR_DB);
        Ok(())
    }
}
