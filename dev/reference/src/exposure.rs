//! Twin of the passes `apply_exposure`, `exposure_backward`, `refine_exposure` and `recentre_exposures`: the affine map of colours M rgb + b that
//! each training photo has, its gradient, and Adam on it.

use crate::adam::{AdamOptions, AdamState, adam_step};
use crate::image_loss::LARGEST_COLOR;

/// Rows (M_r, b_r) of the map M rgb + b from the scene's colours to the photo's.
pub type Exposure = [[f64; 4]; 3];

/// The exposure that changes nothing.
pub const NO_EXPOSURE: Exposure = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// A colour with a 1 behind it. From [`LARGEST_COLOR`] on, and NaN, its channels count as that.
fn extended(rgb: [f64; 3]) -> [f64; 4] {
    let [r, g, b] = rgb.map(|v| if v.abs() < LARGEST_COLOR { v } else { LARGEST_COLOR });
    [r, g, b, 1.0]
}

/// The colour that the photo shows of `rgb`.
pub fn apply(exposure: &Exposure, rgb: [f64; 3]) -> [f64; 3] {
    let extended = extended(rgb);
    exposure.map(|row| row.iter().zip(extended).map(|(m, v)| m * v).sum())
}

/// Gradients of a loss by the scene's colours and by the exposure, from those by the exposed colours (`cotangents`).
pub fn backward(exposure: &Exposure, colors: &[[f64; 3]], cotangents: &[[f64; 3]]) -> (Vec<[f64; 3]>, Exposure) {
    assert_eq!(colors.len(), cotangents.len(), "one cotangent per colour");
    let by_color = |g: &[f64; 3]| [0, 1, 2].map(|c| (0..3).map(|r| exposure[r][c] * g[r]).sum());
    let mut by_exposure = [[0.0; 4]; 3];
    for (rgb, g) in colors.iter().zip(cotangents) {
        let extended = extended(*rgb);
        for (row, g) in by_exposure.iter_mut().zip(g) {
            row.iter_mut().zip(extended).for_each(|(sum, v)| *sum += g * v);
        }
    }
    (cotangents.iter().map(by_color).collect(), by_exposure)
}

/// The exposure of a photo in training.
#[derive(Clone, Debug, PartialEq)]
pub struct ExposureState {
    /// Its numbers, row by row, with their moments.
    pub adam: AdamState,
}

impl Default for ExposureState {
    fn default() -> Self {
        Self { adam: AdamState::new(NO_EXPOSURE.as_flattened().to_vec()) }
    }
}

impl ExposureState {
    /// Step `step` of Adam for this photo, from 1, at learning rate `rate`.
    pub fn step(&mut self, options: &AdamOptions, gradient: &Exposure, step: u64, rate: f64) {
        adam_step(options, &mut self.adam, gradient.as_flattened(), step, ([rate, 0.0], 12));
    }

    /// The exposure now.
    pub fn exposure(&self) -> Exposure {
        std::array::from_fn(|r| std::array::from_fn(|c| self.adam.parameters[4 * r + c]))
    }
}

/// Moves all exposures by the same so that their mean is the identity.
pub fn recentre(photos: &mut [ExposureState]) {
    for (i, identity) in NO_EXPOSURE.as_flattened().iter().enumerate() {
        let mean = photos.iter().map(|photo| photo.adam.parameters[i]).sum::<f64>() / photos.len() as f64;
        photos.iter_mut().for_each(|photo| photo.adam.parameters[i] -= mean - identity);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    /// Central differences of sum(w * exposed) by every colour and every number of the exposure. The map is bilinear, so
    /// they are exact but for rounding.
    #[test]
    fn gradients_agree_with_finite_differences() {
        let mut rng = Rng::new(5);
        let mut exposure = NO_EXPOSURE;
        exposure.as_flattened_mut().iter_mut().for_each(|v| *v += 0.2 * rng.normal());
        let mut random = |n: usize| -> Vec<[f64; 3]> { (0..n).map(|_| [0; 3].map(|_| rng.normal())).collect() };
        let (colors, weights) = (random(7), random(7));
        let loss = |exposure: &Exposure, colors: &[[f64; 3]]| -> f64 {
            let exposed = colors.iter().map(|&rgb| apply(exposure, rgb));
            exposed.zip(&weights).map(|(a, w)| (0..3).map(|c| a[c] * w[c]).sum::<f64>()).sum()
        };
        let (by_color, by_exposure) = backward(&exposure, &colors, &weights);
        let step = 1e-3;
        let difference = |at: &dyn Fn(f64) -> f64| (at(step) - at(-step)) / (2.0 * step);
        for r in 0..3 {
            for c in 0..4 {
                let found = difference(&|h| {
                    let mut moved = exposure;
                    moved[r][c] += h;
                    loss(&moved, &colors)
                });
                assert!((found - by_exposure[r][c]).abs() < 1e-9, "exposure {r} {c}: {found} {:?}", by_exposure[r][c]);
            }
        }
        for i in 0..colors.len() {
            for c in 0..3 {
                let found = difference(&|h| {
                    let mut moved = colors.clone();
                    moved[i][c] += h;
                    loss(&exposure, &moved)
                });
                assert!((found - by_color[i][c]).abs() < 1e-9, "colour {i} {c}");
            }
        }
    }
}
