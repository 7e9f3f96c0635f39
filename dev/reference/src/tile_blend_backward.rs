//! Twin of pass `tile_blend_backward`: from the loss gradient of every pixel to that of every splat.
//!
//! A pixel blends the pairs i = 1..N, front to back: C = sum a_i T_i c_i + T_end background, T_(i+1) = T_i (1 - a_i),
//! T_1 = 1. Let B_i be the colour behind splat i: B_N = background and B_(i-1) = a_i c_i + (1 - a_i) B_i. Then dC/dc_i
//! = a_i T_i and dC/da_i = T_i (c_i - B_i). The pixel's alpha 1 - T_end is the same sum with "colours" 1 and
//! "background" 0. With a = o exp(-sigma): da/do = exp(-sigma) and da/dsigma = -a, both 0 where a is clamped to 0.99.
//! The selection of pairs is constant here, as its derivative is 0 wherever it exists.

use std::collections::BTreeMap;
use std::ops::AddAssign;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::preprocess_instance_expand::{ProjectedSplat, pixel_center};
use crate::tile_blend::{ALPHA_MAX, BlendedPair, blend_row_with_pairs, candidate_boxes};
use crate::view::View;

/// Gradient of a loss with respect to one splat: each field is the derivative with respect to the field of
/// `ProjectedSplat` of the same name.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatGradient {
    /// With respect to the centre, per px.
    pub mean_px: DVec2,
    /// With respect to (a, b, c) of sigma = (a dx^2 + c dy^2) / 2 + b dx dy, per px^-2; b counted once.
    pub conic: [f64; 3],
    /// With respect to the opacity after sigmoid and compensation.
    pub opacity: f64,
    /// With respect to the clamped colour.
    pub color: DVec3,
}

impl AddAssign for SplatGradient {
    fn add_assign(&mut self, other: Self) {
        self.mean_px += other.mean_px;
        self.conic.iter_mut().zip(other.conic).for_each(|(sum, v)| *sum += v);
        self.opacity += other.opacity;
        self.color += other.color;
    }
}

/// Gradients of `splats`, which are in depth order, in the same order. `cotangents` has one entry per pixel, row by
/// row: (dL/dr, dL/dg, dL/db, dL/dalpha), with the colour over the background and alpha = 1 - T.
pub fn blend_backward(view: &View, splats: &[ProjectedSplat], cotangents: &[[f64; 4]]) -> Vec<SplatGradient> {
    let width = view.width as usize;
    assert_eq!(cotangents.len(), width * view.height as usize, "one cotangent per pixel");
    let boxes = candidate_boxes(view, splats);
    // Rows are summed in order, so that the result does not depend on the number of threads.
    let rows: Vec<BTreeMap<usize, SplatGradient>> = (0..view.height)
        .into_par_iter()
        .map(|y| {
            let mut sums = BTreeMap::new();
            for (x, (_, pairs)) in blend_row_with_pairs(view, splats, &boxes, y).iter().enumerate() {
                let cotangent = cotangents[y as usize * width + x];
                pixel_backward(view, splats, pairs, pixel_center(x as u32, y), cotangent, |splat, gradient| {
                    *sums.entry(splat).or_default() += gradient;
                });
            }
            sums
        })
        .collect();
    let mut out = vec![SplatGradient::default(); splats.len()];
    rows.into_iter().flatten().for_each(|(splat, gradient)| out[splat] += gradient);
    out
}

/// Calls `add` with the index and the gradient of every pair of one pixel, back to front.
fn pixel_backward(
    view: &View,
    splats: &[ProjectedSplat],
    pairs: &[BlendedPair],
    center_px: DVec2,
    cotangent: [f64; 4],
    mut add: impl FnMut(usize, SplatGradient),
) {
    let [r, g, b, d_alpha_pixel] = cotangent;
    let d_color_pixel = DVec3::new(r, g, b);
    // Transmittance in front of each pair, and behind the last one, which `zip` ignores.
    let mut in_front = vec![1.0];
    for (i, pair) in pairs.iter().enumerate() {
        in_front.push(in_front[i] * (1.0 - alpha(pair)));
    }
    // dL/dC . B_i plus dL/dalpha times the alpha behind splat i.
    let mut behind = d_color_pixel.dot(DVec3::from_array(view.options.background));
    for (pair, &t) in pairs.iter().zip(&in_front).rev() {
        let splat = &splats[pair.splat];
        let alpha = alpha(pair);
        let own = d_color_pixel.dot(splat.color) + d_alpha_pixel;
        let d_alpha = t * (own - behind);
        behind = alpha * own + (1.0 - alpha) * behind;
        let mut gradient = SplatGradient { color: alpha * t * d_color_pixel, ..SplatGradient::default() };
        if pair.alpha_raw <= ALPHA_MAX {
            let d_sigma = -pair.alpha_raw * d_alpha;
            let [a, b, c] = splat.conic;
            let d = center_px - splat.mean_px;
            gradient.opacity = (-splat.sigma_at(center_px)).exp() * d_alpha;
            gradient.mean_px = -d_sigma * DVec2::new(a * d.x + b * d.y, b * d.x + c * d.y);
            gradient.conic = [0.5 * d.x * d.x, d.x * d.y, 0.5 * d.y * d.y].map(|v| d_sigma * v);
        }
        add(pair.splat, gradient);
    }
}

/// The alpha that a pair is blended with.
fn alpha(pair: &BlendedPair) -> f64 {
    pair.alpha_raw.min(ALPHA_MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::RenderOptions;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::camera::Camera;

    /// An image of 1x1 pixel over the background (0, 0.5, 1).
    fn view() -> View {
        let camera = Camera::look_at("one", DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0, (1, 1));
        View::exact(&camera, &RenderOptions { background: [0.0, 0.5, 1.0], ..RenderOptions::default() })
    }

    /// A round splat of unit variance, `offset_px` to the left of the only pixel's centre.
    fn splat(depth: f64, opacity: f64, gray: f64, offset_px: f64) -> ProjectedSplat {
        ProjectedSplat {
            flat_index: depth as u32,
            depth,
            depth_origin: (Similarity::IDENTITY, DVec3::new(0.0, 0.0, depth)),
            depth_terms: depth,
            mean_px: DVec2::new(0.5 - offset_px, 0.5),
            conic: [1.0, 0.0, 1.0],
            opacity,
            color: DVec3::splat(gray),
            tau_ln: (255.0 * opacity).ln(),
            variance_px: DVec2::ONE,
            half_extent_px: DVec2::splat(4.0),
        }
    }

    /// C = a c1 + (1 - a) b c2 + (1 - a)(1 - b) background, alpha = 1 - (1 - a)(1 - b), a = b = 0.5. Measured: 0.
    #[test]
    fn two_splats_by_hand() {
        let got =
            blend_backward(&view(), &[splat(1.0, 0.5, 1.0, 0.0), splat(2.0, 0.5, 0.2, 0.0)], &[[0.0, 1.0, 0.0, 10.0]]);
        assert_eq!([got[0].color, got[1].color], [DVec3::new(0.0, 0.5, 0.0), DVec3::new(0.0, 0.25, 0.0)]);
        // dC/da = c1 - b c2 - (1 - b) background, dalpha/da = 1 - b; dC/db = (1 - a)(c2 - background).
        let want = [1.0 - 0.1 - 0.25 + 10.0 * 0.5, 0.5 * (0.2 - 0.5) + 10.0 * 0.5];
        assert!((got[0].opacity - want[0]).abs() < 1e-14 && (got[1].opacity - want[1]).abs() < 1e-14, "{got:?}");
        // At the centre of a splat the gradient by position is 0.
        assert!(got.iter().all(|g| g.mean_px == DVec2::ZERO && g.conic == [0.0; 3]));
    }

    /// One splat 1 px to the left: alpha = o e^(-1/2), dalpha/dx = +alpha: moving right brings it closer. Measured: 0.
    #[test]
    fn a_shifted_splat_by_hand() {
        let got = blend_backward(&view(), &[splat(1.0, 0.5, 0.0, 1.0)], &[[0.0, 0.0, 0.0, 1.0]])[0];
        let bell = (-0.5f64).exp();
        assert!((got.opacity - bell).abs() < 1e-15);
        assert!((got.mean_px - DVec2::new(0.5 * bell, 0.0)).length() < 1e-15);
        assert!((got.conic[0] + 0.25 * bell).abs() < 1e-15 && got.conic[1..] == [0.0, 0.0]);
    }

    /// A clamped alpha passes gradients to the colour only; skipped splats and those behind the end get none.
    #[test]
    fn rules_cut_gradients() {
        let splats = [
            splat(1.0, 0.999, 1.0, 0.0),
            splat(2.0, 0.9 / 255.0, 1.0, 0.0),
            splat(3.0, 0.5, 1.0, 0.0),
            splat(4.0, 0.985, 1.0, 0.0),
            splat(5.0, 0.1, 1.0, 0.0),
        ];
        let got = blend_backward(&view(), &splats, &[[1.0; 4]]);
        assert!((got[0].color - 0.99).length() < 1e-15);
        assert_eq!((got[0].opacity, got[0].mean_px, got[0].conic), (0.0, DVec2::ZERO, [0.0; 3]));
        assert_eq!([got[1], got[3], got[4]], [SplatGradient::default(); 3]);
        assert!((got[2].color - 0.005).length() < 1e-15 && got[2].opacity > 0.0);
    }
}
