//! Colours as brightness and two differences. Red, green and blue of a surface are alike, so that brightness is large and the
//! differences are small. The three numbers are those of an orthonormal basis: an error keeps its length.

use std::f64::consts::FRAC_1_SQRT_2;

/// 1 / sqrt 3, which brings (1, 1, 1), brightness, to length 1.
const ROOT_THIRD: f64 = 0.577_350_269_189_625_8;
/// 1 / sqrt 6, which brings (1, -2, 1), red and blue against green, to length 1.
const ROOT_SIXTH: f64 = ROOT_THIRD * FRAC_1_SQRT_2;

/// Brightness (r + g + b) / sqrt 3, red against blue (r - b) / sqrt 2, and both against green (r - 2 g + b) / sqrt 6.
// Number by number, here and below: `map` of arrays is not always inlined, and a file has millions of colours.
#[inline]
pub fn opponent_from_rgb([r, g, b]: [f32; 3]) -> [f32; 3] {
    let (r, g, b) = (f64::from(r), f64::from(g), f64::from(b));
    [(ROOT_THIRD * (r + g + b)) as f32, (FRAC_1_SQRT_2 * (r - b)) as f32, (ROOT_SIXTH * (r - 2.0 * g + b)) as f32]
}

/// The inverse of [`opponent_from_rgb`].
#[inline]
pub fn rgb_from_opponent([brightness, red_blue, green]: [f32; 3]) -> [f32; 3] {
    let mean = ROOT_THIRD * f64::from(brightness);
    let (half, part) = (FRAC_1_SQRT_2 * f64::from(red_blue), ROOT_SIXTH * f64::from(green));
    [(mean + half + part) as f32, (mean - 2.0 * part) as f32, (mean - half + part) as f32]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    #[test]
    fn it_is_a_rotation_of_the_colours() {
        let mut rng = Rng::new(1);
        for _ in 0..200 {
            let rgb: [f32; 3] = std::array::from_fn(|_| rng.normal() as f32);
            let opponent = opponent_from_rgb(rgb);
            let back = rgb_from_opponent(opponent);
            assert!(rgb.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-6), "{rgb:?} {back:?}");
            let length = |v: [f32; 3]| v.iter().map(|v| v * v).sum::<f32>();
            assert!((length(rgb) - length(opponent)).abs() < 1e-5, "{rgb:?} {opponent:?}");
        }
        let [brightness, red_blue, green] = opponent_from_rgb([0.5; 3]);
        assert!((brightness - 0.75f32.sqrt()).abs() < 1e-6 && red_blue == 0.0 && green == 0.0);
    }
}
