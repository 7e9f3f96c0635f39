//! Twin of pass `tile_blend`: blends the depth-sorted splats of every pixel front to back, without tiles.
//!
//! 3DGS Eq. 3 with alpha = min(0.99, opacity exp(-sigma)), skipped below 1/255; a pixel ends before the splat that
//! would bring T below 1e-4; C += alpha T color; finally + T background.
//!
//! A pixel is *robust* if f32 and f64 must take the same decisions in it. It is not if one is too close: alpha near
//! 1/255 or 0.99, T near 1e-4, depths too close to be surely ordered, depth at the near plane.

use glam::DVec3;
use rayon::prelude::*;

use crate::preprocess_instance_expand::{ALPHA_MIN, CullLimits, ProjectedSplat, pixel_center};
use crate::view::View;

/// Largest alpha of one splat.
pub const ALPHA_MAX: f64 = 0.99;
/// A splat that brings the transmittance below this ends the pixel and is not blended.
pub const TRANSMITTANCE_MIN: f64 = 1e-4;

/// A pixel is not robust if |255 alpha - 1| is below this.
pub const ALPHA_MIN_MARGIN: f64 = 1e-3;
/// A pixel is not robust if |opacity exp(-sigma) - 0.99| is below this.
pub const ALPHA_MAX_MARGIN: f64 = 1e-4;
/// A pixel is not robust if |T_next / 1e-4 - 1| is below this.
pub const TRANSMITTANCE_MARGIN: f64 = 2e-3;
/// A pixel is not robust if the relative depth gap of two of its splats is below this.
pub const DEPTH_GAP_MIN: f64 = 2e-6;
/// A pixel is not robust if the relative distance of a depth from the near plane is below this.
pub const NEAR_MARGIN: f64 = 1e-5;
/// f32 error of a depth as a fraction of the sum of its absolute terms: 8 roundings of 2^-24, the length of the
/// chain p + d, A p (3), + t, R x (3).
pub const DEPTH_ROUNDING: f64 = 8.0 / 16_777_216.0;

/// One pixel of the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlendedPixel {
    /// Colour over the background.
    pub color: DVec3,
    /// Alpha of the pixel, 1 - T.
    pub alpha: f64,
    /// Expected view depth sum(w z) / sum(w), scene units; 0 where nothing was blended.
    pub depth: f64,
    /// Number of splats blended.
    pub n_contrib: u32,
    /// Whether f32 must agree: see the module's documentation.
    pub robust: bool,
}

/// One splat blended into one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlendedPair {
    /// Index into the splats in depth order.
    pub splat: usize,
    /// opacity exp(-sigma) at the pixel's centre, before the clamp to 0.99.
    pub alpha_raw: f64,
}

/// Limits that also accept splats which f32 might draw although f64 does not.
pub fn relaxed_limits(view: &View) -> CullLimits {
    // The device's error in depth is not known before projection; a tenth of near covers an error of `DEPTH_ROUNDING`
    // for depth terms up to 2e5 near. `near_at_risk` then decides with the actual terms.
    CullLimits { near: 0.9 * view.options.near, opacity_min: ALPHA_MIN * (1.0 - ALPHA_MIN_MARGIN) }
}

/// True if f32 might place the splat on the other side of the near plane.
pub(super) fn near_at_risk(splat: &ProjectedSplat, near: f64) -> bool {
    (splat.depth - near).abs() <= (NEAR_MARGIN * near).max(DEPTH_ROUNDING * splat.depth_terms)
}

/// True if f32 might order the two splats differently. Equal inputs give equal depths, which the flat index orders.
pub(super) fn order_at_risk(a: &ProjectedSplat, b: &ProjectedSplat) -> bool {
    let rounding = DEPTH_ROUNDING * a.depth_terms.max(b.depth_terms);
    a.depth_origin != b.depth_origin && (a.depth - b.depth).abs() <= (DEPTH_GAP_MIN * a.depth).max(rounding)
}

/// State of a pixel while its splats are visited front to back.
#[derive(Clone, Copy)]
struct Walk<'a> {
    color: DVec3,
    transmittance: f64,
    weighted_depth: f64,
    n_contrib: u32,
    robust: bool,
    /// Whether a splat would have brought T below its minimum.
    stopped: bool,
    /// Whether the pixel has stopped, and all later splats are surely behind the splat that stopped it.
    finished: bool,
    /// The last splat that contributes, or might in f32.
    last_candidate: Option<&'a ProjectedSplat>,
}

impl<'a> Walk<'a> {
    const START: Self = Self {
        color: DVec3::ZERO,
        transmittance: 1.0,
        weighted_depth: 0.0,
        n_contrib: 0,
        robust: true,
        stopped: false,
        finished: false,
        last_candidate: None,
    };

    /// Visits one splat with `alpha_raw` = opacity exp(-sigma) at this pixel; false if it is not blended.
    fn visit(&mut self, splat: &'a ProjectedSplat, alpha_raw: f64, near: f64) -> bool {
        let candidate = 255.0 * alpha_raw > 1.0 - ALPHA_MIN_MARGIN;
        if self.finished || !candidate {
            return false;
        }
        let order_unsafe = self.last_candidate.is_some_and(|last| order_at_risk(last, splat));
        self.last_candidate = Some(splat);
        if self.stopped {
            // Ordered before the splat that stopped the pixel, this one might have been blended.
            self.robust &= !order_unsafe;
            self.finished = !order_unsafe;
            return false;
        }
        let fragile = order_unsafe
            || near_at_risk(splat, near)
            || (255.0 * alpha_raw - 1.0).abs() < ALPHA_MIN_MARGIN
            || (alpha_raw - ALPHA_MAX).abs() < ALPHA_MAX_MARGIN;
        self.robust &= !fragile;
        let drawn = splat.depth > near && alpha_raw >= ALPHA_MIN;
        drawn && self.blend(splat, alpha_raw.min(ALPHA_MAX))
    }

    /// Blends a splat; false if it ends the pixel instead.
    fn blend(&mut self, splat: &ProjectedSplat, alpha: f64) -> bool {
        let next = self.transmittance * (1.0 - alpha);
        self.robust &= (next / TRANSMITTANCE_MIN - 1.0).abs() >= TRANSMITTANCE_MARGIN;
        if next < TRANSMITTANCE_MIN {
            self.stopped = true;
            return false;
        }
        let weight = alpha * self.transmittance;
        self.color += weight * splat.color;
        self.weighted_depth += weight * splat.depth;
        self.transmittance = next;
        self.n_contrib += 1;
        true
    }

    fn finish(&self, background: DVec3) -> BlendedPixel {
        // The sum of the weights telescopes to 1 - T.
        let alpha = 1.0 - self.transmittance;
        BlendedPixel {
            color: self.color + self.transmittance * background,
            alpha,
            depth: if self.n_contrib > 0 { self.weighted_depth / alpha } else { 0.0 },
            n_contrib: self.n_contrib,
            robust: self.robust,
        }
    }
}

/// All pixels of the view, row by row. `splats` are in depth order and may include ones that only the relaxed limits
/// accept: these draw nothing and only affect robustness.
pub fn blend(view: &View, splats: &[ProjectedSplat]) -> Vec<BlendedPixel> {
    let boxes = candidate_boxes(view, splats);
    let background = DVec3::from_array(view.options.background);
    let rows: Vec<Vec<BlendedPixel>> = (0..view.height)
        .into_par_iter()
        .map(|y| walk_row(view, splats, &boxes, y, |_, _| {}).iter().map(|walk| walk.finish(background)).collect())
        .collect();
    rows.concat()
}

/// Row `y` of the result with the pairs of each pixel, front to back. `boxes` are `candidate_boxes`.
pub fn blend_row_with_pairs(
    view: &View,
    splats: &[ProjectedSplat],
    boxes: &[[u32; 4]],
    y: u32,
) -> Vec<(BlendedPixel, Vec<BlendedPair>)> {
    let background = DVec3::from_array(view.options.background);
    let mut pairs = vec![Vec::new(); view.width as usize];
    let row = walk_row(view, splats, boxes, y, |x, pair| pairs[x as usize].push(pair));
    row.iter().map(|walk| walk.finish(background)).zip(pairs).collect()
}

/// Per splat, the pixels `[x0, x1, y0, y1]`, ends exclusive, outside which it neither contributes nor might in f32.
pub fn candidate_boxes(view: &View, splats: &[ProjectedSplat]) -> Vec<[u32; 4]> {
    splats.iter().map(|s| s.pixel_box(view.width, view.height, 2.0 * ALPHA_MIN_MARGIN)).collect()
}

/// The pixels of row `y`; `on_blend` gets the column of every blended pair, each column's pairs front to back.
fn walk_row<'a>(
    view: &View,
    splats: &'a [ProjectedSplat],
    boxes: &[[u32; 4]],
    y: u32,
    mut on_blend: impl FnMut(u32, BlendedPair),
) -> Vec<Walk<'a>> {
    let mut row = vec![Walk::START; view.width as usize];
    for (index, (splat, &[x0, x1, y0, y1])) in splats.iter().zip(boxes).enumerate() {
        if !(y0..y1).contains(&y) {
            continue;
        }
        for x in x0..x1 {
            let alpha_raw = splat.alpha_at(pixel_center(x, y));
            if row[x as usize].visit(splat, alpha_raw, view.options.near) {
                on_blend(x, BlendedPair { splat: index, alpha_raw });
            }
        }
    }
    row
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::view::RenderOptions;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::camera::Camera;

    /// An image of 1x1 pixel with the given background.
    fn view(background: [f64; 3]) -> View {
        let camera = Camera::look_at("one", DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0, (1, 1));
        View::exact(&camera, &RenderOptions { background, ..RenderOptions::default() })
    }

    /// A splat centred on the only pixel.
    fn splat(flat_index: u32, depth: f64, opacity: f64, gray: f64) -> ProjectedSplat {
        ProjectedSplat {
            flat_index,
            depth,
            depth_origin: (Similarity::IDENTITY, DVec3::new(0.0, 0.0, depth)),
            depth_terms: depth,
            mean_px: DVec2::splat(0.5),
            conic: [1.0, 0.0, 1.0],
            opacity,
            color: DVec3::splat(gray),
            tau_ln: (255.0 * opacity).ln(),
            variance_px: DVec2::ONE,
            half_extent_px: DVec2::ONE,
        }
    }

    fn only_pixel(splats: &[ProjectedSplat]) -> BlendedPixel {
        blend(&view([0.0, 0.5, 1.0]), splats)[0]
    }

    /// Two splats by hand. Measured: 0, in the next two tests as well.
    #[test]
    fn two_splats_by_hand() {
        let pixel = only_pixel(&[splat(0, 1.0, 0.5, 1.0), splat(1, 3.0, 0.5, 0.2)]);
        assert!((pixel.color - DVec3::new(0.55, 0.675, 0.8)).length() < 1e-15);
        assert!((pixel.alpha - 0.75).abs() < 1e-15);
        assert!((pixel.depth - (0.5 * 1.0 + 0.25 * 3.0) / 0.75).abs() < 1e-15);
        assert_eq!((pixel.n_contrib, pixel.robust), (2, true));
    }

    #[test]
    fn nothing_gives_the_background() {
        let pixel = only_pixel(&[]);
        assert_eq!((pixel.color, pixel.alpha, pixel.depth), (DVec3::new(0.0, 0.5, 1.0), 0.0, 0.0));
    }

    /// Opacity 1 is clamped to 0.99: T = 1e-2, then about 1e-4 (not robust, and not below), then the third stops.
    #[test]
    fn opaque_splats_stop_before_the_limit() {
        let opaque =
            [splat(0, 1.0, 1.0, 1.0), splat(1, 2.0, 0.98, 1.0), splat(2, 3.0, 0.98, 1.0), splat(3, 4.0, 0.1, 1.0)];
        let pixel = only_pixel(&opaque);
        assert_eq!((pixel.n_contrib, pixel.robust), (2, true));
        assert!((pixel.alpha - (1.0 - 0.01 * 0.02)).abs() < 1e-15);
    }

    #[test]
    fn every_threshold_costs_robustness() {
        let fragile = |splats: &[ProjectedSplat]| !only_pixel(splats).robust;
        assert!(fragile(&[splat(0, 1.0, 1.0005 / 255.0, 1.0)]), "just above 1/255");
        assert!(fragile(&[splat(0, 1.0, 0.9995 / 255.0, 1.0)]), "just below 1/255");
        assert!(!fragile(&[splat(0, 1.0, 0.998 / 255.0, 1.0)]), "clearly below 1/255");
        assert!(fragile(&[splat(0, 1.0, 0.99005, 1.0)]), "at the clamp");
        assert!(fragile(&[splat(0, 1.0, 1.0, 1.0), splat(1, 2.0, 0.98999, 1.0)]), "T at its minimum");
        assert!(fragile(&[splat(0, 1.0, 0.5, 1.0), splat(1, 1.000001, 0.5, 0.0)]), "depths too close");
        assert!(!fragile(&[splat(0, 1.0, 0.5, 1.0), splat(1, 1.0, 0.5, 0.0)]), "the same depth from the same inputs");
        assert!(!fragile(&[splat(0, 1.0, 0.5, 1.0), splat(1, 1.00001, 0.5, 0.0)]), "depths far enough apart");
        assert!(fragile(&[splat(0, 0.2000001, 0.5, 1.0)]), "just beyond near");
        assert!(fragile(&[splat(0, 0.1999999, 0.5, 1.0)]), "just before near");
        assert_eq!(only_pixel(&[splat(0, 0.1999999, 0.5, 1.0)]).n_contrib, 0);
        let stop =
            [splat(0, 1.0, 1.0, 1.0), splat(1, 2.0, 0.98, 1.0), splat(2, 3.0, 0.9, 1.0), splat(3, 3.000001, 0.1, 1.0)];
        assert!(fragile(&stop), "the splat that stops and the next one are too close");
    }
}
