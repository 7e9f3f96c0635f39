//! Quality up to the exposure of the photo: a test photo's exposure is no more known than that of a training photo, and it
//! is not the scene's fault. Each half of the picture gets the affine map of colours that fits the other half best, so that
//! no pixel is judged by a map that has seen it.

use glam::{DMat4, DVec4};

use crate::pair::PicturePair;

/// Weight of "unchanged" in the fit, in pixels: what a half does not tell stays as it is.
const PRIOR_PIXELS: f64 = 10.0;

/// Channels of a map: each is a row (M_r, b_r) of M rgb + b.
type ColorMap = [DVec4; 3];

/// The pair with the render's left half mapped by what fits the right half of the photo best in least squares, and the
/// other way round. A half of which no pixel counts maps nothing.
pub fn with_exposures(pair: &PicturePair) -> PicturePair {
    let width = pair.width() as usize;
    let is_left = |i: usize| i % width < width / 2;
    let [left, right] = [true, false].map(|of_left| fitted(pair, |i| is_left(i) == of_left));
    pair.recolored(|i| {
        let map = if is_left(i) { &right } else { &left };
        map.map(|row| row.dot(extended(pair.render()[i])) as f32)
    })
}

fn extended(rgb: [f32; 3]) -> DVec4 {
    let [r, g, b] = rgb.map(f64::from);
    DVec4::new(r, g, b, 1.0)
}

/// The map of the render's colours that fits the photo best over the pixels of `part` that count.
fn fitted(pair: &PicturePair, part: impl Fn(usize) -> bool) -> ColorMap {
    let unchanged = [DVec4::X, DVec4::Y, DVec4::Z];
    let mut moments = DMat4::from_diagonal(DVec4::splat(PRIOR_PIXELS));
    let mut by_channel = unchanged.map(|row| PRIOR_PIXELS * row);
    for i in (0..pair.render().len()).filter(|&i| pair.counts(i) && part(i)) {
        let rgb = extended(pair.render()[i]);
        moments += DMat4::from_cols(rgb.x * rgb, rgb.y * rgb, rgb.z * rgb, rgb.w * rgb);
        for (sum, wanted) in by_channel.iter_mut().zip(pair.target()[i]) {
            *sum += f64::from(wanted) * rgb;
        }
    }
    // The prior makes it invertible.
    let inverse = moments.inverse();
    by_channel.map(|sum| inverse * sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::PairError;
    use crate::psnr::psnr;

    /// A picture of many colours, and the photo that a map makes of it.
    fn pair(map: &ColorMap) -> Result<PicturePair, PairError> {
        let (width, height) = (64, 48);
        let color = |i: usize| [(i * 7 % 61) as f32 / 90.0, (i * 11 % 53) as f32 / 90.0, (i * 13 % 47) as f32 / 90.0];
        let render: Vec<[f32; 3]> = (0..width * height).map(color).collect();
        let target: Vec<[f32; 3]> = render.iter().map(|&rgb| map.map(|row| row.dot(extended(rgb)) as f32)).collect();
        PicturePair::new((width as u32, height as u32), &render, &target, None)
    }

    #[test]
    fn an_exposure_is_taken_out_and_an_error_is_not() -> Result<(), PairError> {
        let brighter =
            [DVec4::new(1.2, 0.05, 0.0, 0.02), DVec4::new(0.0, 1.1, 0.03, 0.05), DVec4::new(0.02, 0.0, 0.8, 0.1)];
        let found = pair(&brighter)?;
        let (before, after) = (psnr(&found), psnr(&with_exposures(&found)));
        assert!(before < 25.0 && after > 40.0, "{before} {after}");
        // The left half is brighter than the right one: no exposure of a photo is, so the halves do not help each other.
        let lopsided: Vec<[f32; 3]> = (0..found.render().len())
            .map(|i| found.render()[i].map(|v| if i % 64 < 32 { v + 0.1 } else { v }))
            .collect();
        let lopsided = PicturePair::new((64, 48), &lopsided, found.render(), None)?;
        let (before, after) = (psnr(&lopsided), psnr(&with_exposures(&lopsided)));
        assert!(after < before, "{before} {after}");
        Ok(())
    }

    #[test]
    fn what_does_not_count_is_not_fitted() -> Result<(), PairError> {
        let found = pair(&[DVec4::X, DVec4::Y, DVec4::Z])?;
        let mut wrong = found.render().to_vec();
        wrong[..64 * 10].fill([1.0, 0.0, 1.0]);
        let valid: Vec<bool> = (0..wrong.len()).map(|i| i >= 64 * 10).collect();
        let masked = PicturePair::new((64, 48), &wrong, found.target(), Some(&valid))?;
        assert!(psnr(&with_exposures(&masked)) > 90.0);
        // Nothing on the left counts: the right half stays as it is.
        let valid: Vec<bool> = (0..wrong.len()).map(|i| i % 64 >= 32).collect();
        let half = PicturePair::new((64, 48), &wrong, found.target(), Some(&valid))?;
        let (before, after) = (psnr(&half), psnr(&with_exposures(&half)));
        assert!((before - after).abs() < 1e-4, "{before} {after}");
        Ok(())
    }
}
