//! Twin of the passes `apply_exposure`, `exposure_backward`, `refine_exposure` and `recentre_exposures`: the affine map of colours M rgb + b that
//! each training photo has, its gradient, and Adam on it.

use crate::adam::{AdamOptions, AdamState, adam_step};
use crate::image_loss::LARGEST_COLOR;

/// Rows (M_r, b_r) of the map M rgb + b from the scene's colours to the photo's.
pub type Exposure = [[f64; 4]; 3];

/// The exposure that changes nothing.
pub const NO_EXPOSURE: Exposure = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// What the rows of an exposure are multiplied by: a picture's colour (rgb over the background, alpha) without the background,
/// and alpha. From [`LARGEST_COLOR`] on, and NaN, channels count as that.
fn exposable([r, g, b, alpha]: [f64; 4], background: [f64; 3]) -> [f64; 4] {
    let own = |v: f64, behind: f64| (if v.abs() < LARGEST_COLOR { v } else { LARGEST_COLOR }) - (1.0 - alpha) * behind;
    [own(r, background[0]), own(g, background[1]), own(b, background[2]), alpha]
}

fn dot(row: [f64; 4], values: [f64; 4]) -> f64 {
    row.iter().zip(values).map(|(m, v)| m * v).sum()
}

/// The colour that the photo shows of a picture's colour: rgb over `background`, and alpha. The background stays as it is.
pub fn apply(exposure: &Exposure, color: [f64; 4], background: [f64; 3]) -> [f64; 3] {
    let values = exposable(color, background);
    [0, 1, 2].map(|c| dot(exposure[c], values) + (1.0 - color[3]) * background[c])
}

/// Gradients of a loss by a picture's colours (rgb over `background`, alpha) and by the exposure, from those by the exposed
/// colours (`cotangents`).
pub fn backward(
    exposure: &Exposure,
    colors: &[[f64; 4]],
    background: [f64; 3],
    cotangents: &[[f64; 3]],
) -> (Vec<[f64; 4]>, Exposure) {
    assert_eq!(colors.len(), cotangents.len(), "one cotangent per colour");
    let [x, y, z] = background;
    let by_color = |g: &[f64; 3]| {
        let [r, gr, b] = [0, 1, 2].map(|c| (0..3).map(|r| exposure[r][c] * g[r]).sum());
        let by_alpha = (0..3).map(|r| g[r] * (dot(exposure[r], [x, y, z, 1.0]) - background[r])).sum();
        [r, gr, b, by_alpha]
    };
    let mut by_exposure = [[0.0; 4]; 3];
    for (color, g) in colors.iter().zip(cotangents) {
        let values = exposable(*color, background);
        for (row, g) in by_exposure.iter_mut().zip(g) {
            row.iter_mut().zip(values).for_each(|(sum, v)| *sum += g * v);
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

    /// Central differences of sum(w * exposed) by every colour, every alpha and every number of the exposure. The map is bilinear, so
    /// they are exact but for rounding.
    #[test]
    fn gradients_agree_with_finite_differences() {
        let mut rng = Rng::new(5);
        let mut exposure = NO_EXPOSURE;
        exposure.as_flattened_mut().iter_mut().for_each(|v| *v += 0.2 * rng.normal());
        let background = [0.3, 0.6, 0.9];
        let colors: Vec<[f64; 4]> = (0..7).map(|_| [0; 4].map(|_| rng.uniform())).collect();
        let weights: Vec<[f64; 3]> = (0..7).map(|_| [0; 3].map(|_| rng.normal())).collect();
        let loss = |exposure: &Exposure, colors: &[[f64; 4]]| -> f64 {
            let exposed = colors.iter().map(|&color| apply(exposure, color, background));
            exposed.zip(&weights).map(|(a, w)| (0..3).map(|c| a[c] * w[c]).sum::<f64>()).sum()
        };
        let (by_color, by_exposure) = backward(&exposure, &colors, background, &weights);
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
            for c in 0..4 {
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
