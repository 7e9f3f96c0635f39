//! Twin of `glsl/include/lod.glsl`, which `cull_instances` and `preprocess_instance_expand` share: selects the levels
//! of detail that are drawn, and their weights.

use glam::DVec3;

use crate::preprocess_instance_expand::{SourceGaussian, push_sources, widened_rows};
use crate::view::View;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::lod::{Cloud, Levels, Part};

/// A level fades in while its cells shrink on the screen from the allowed error to this many octaves below it.
pub const FADE_OCTAVES: f64 = 0.25;

/// The Gaussians that a view with an allowed error of `error_px` draws, in flat order: those of all levels with a
/// weight above 0. A weight below 1 scales their optical depth.
pub fn sources(levels: &Levels, view: &View, error_px: f64) -> Vec<SourceGaussian> {
    let mut out = Vec::new();
    for part in &levels.parts {
        let weight = level_weight(levels, part, view, error_px);
        if weight <= 0.0 {
            continue;
        }
        let first = out.len();
        let offsets = part.first_offset.map(|first| (&levels.offsets, first));
        push_sources(&mut out, (cloud_of(levels, part), part.range), offsets, part.world_from_template, part.owner);
        let local_before = if let Cloud::Own { local_before } = part.cloud { local_before } else { 0 };
        out[first..].iter_mut().for_each(|source| source.local_index += local_before);
        if part.cloud == Cloud::Templates {
            let color_from_template = levels.color_from_template.get(part.owner as usize).map(widened_rows);
            out[first..].iter_mut().for_each(|source| source.color_from_template = color_from_template);
        }
        if weight < 1.0 {
            out[first..].iter_mut().for_each(|source| source.opacity_logit = faded(source.opacity_logit, weight));
        }
    }
    out
}

/// Weight of a part, 0..=1; the weights of all parts of one instance or block add up to 1.
pub fn level_weight(levels: &Levels, part: &Part, view: &View, error_px: f64) -> f64 {
    let px = pixels_per_unit(levels, part, view);
    fade_in(part.cell.into(), px, error_px) - fade_in(part.next_cell.into(), px, error_px)
}

/// Logit of the opacity `1 - (1 - sigmoid(logit))^weight`.
pub fn faded(opacity_logit: f64, weight: f64) -> f64 {
    let optical_depth = opacity_logit.max(0.0) + (-opacity_logit.abs()).exp().ln_1p();
    (weight * optical_depth).exp_m1().ln()
}

/// Width in pixels of one template unit, at the point closest to the camera of the ball around the means at full
/// detail.
fn pixels_per_unit(levels: &Levels, part: &Part, view: &View) -> f64 {
    let (center, radius) = ball(levels, part);
    let center_world = part.world_from_template.transform_point(center);
    let depth = (view.view_from_world * center_world + view.world_origin_view).z;
    let scale = part.world_from_template.scale();
    let px = view.focal_px.max_element() * scale / (depth - scale * radius).max(view.options.near);
    if px < 1e30 { px } else { 1e30 }
}

fn fade_in(cell: f64, px: f64, error_px: f64) -> f64 {
    if cell > 0.0 { ((error_px / (cell * px)).log2() / FADE_OCTAVES).clamp(0.0, 1.0) } else { 1.0 }
}

/// Centre and radius of the ball around the means, centred on their bounding box.
fn ball(levels: &Levels, part: &Part) -> (DVec3, f64) {
    let (first, count) = (part.full.first as usize, part.full.count as usize);
    let means: Vec<DVec3> = cloud_of(levels, part).means[first..first + count].iter().map(|&m| widened(m)).collect();
    let low = means.iter().fold(DVec3::INFINITY, |low, &m| low.min(m));
    let high = means.iter().fold(DVec3::NEG_INFINITY, |high, &m| high.max(m));
    let center = 0.5 * (low + high);
    (center, means.iter().map(|m| m.distance(center)).fold(0.0, f64::max))
}

fn cloud_of<'a>(levels: &'a Levels, part: &Part) -> &'a instgs_vk::scene::Gaussians {
    match part.cloud {
        Cloud::Templates => &levels.templates,
        Cloud::Own { .. } => &levels.own,
        Cloud::Background => &levels.background,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::covariance::{logit, sigmoid};

    #[test]
    fn weights_of_neighbours_add_up_to_one() {
        let cells = [0.0, 0.25, 0.5, 2.0, 1e30];
        let (mut fading, mut whole) = (0, 0);
        for step in -400..400 {
            let px = 2f64.powf(f64::from(step) / 40.0);
            let weights: Vec<f64> = cells.windows(2).map(|c| fade_in(c[0], px, 2.0) - fade_in(c[1], px, 2.0)).collect();
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{px}: {weights:?}");
            assert!(weights.iter().all(|&w| (0.0..=1.0).contains(&w)), "{px}: {weights:?}");
            // No level is drawn whose cells are wider than the allowed error.
            assert!(cells.iter().zip(&weights).all(|(cell, &w)| w == 0.0 || cell * px <= 2.0), "{px}: {weights:?}");
            let shown = weights.iter().filter(|&&w| w > 0.0).count();
            fading += u32::from(shown == 2);
            whole += u32::from(shown == 1);
        }
        assert!(fading >= 27 && whole > 700 && fading + whole == 800, "{fading} {whole}");
        assert_eq!(fade_in(0.25, 1.0, 0.0), 0.0);
    }

    #[test]
    fn two_faded_layers_take_as_much_light_as_one() {
        for x in [-20.0, -3.0, 0.0, 2.0, 9.0] {
            for weight in [0.1, 0.5, 0.9] {
                let left = |w: f64| 1.0 - sigmoid(faded(x, w));
                let (both, one) = (left(weight) * left(1.0 - weight), 1.0 - sigmoid(x));
                assert!((both / one - 1.0).abs() < 1e-6, "{x} {weight}: {both} {one}");
            }
        }
        assert!((faded(logit(0.75), 0.5) - logit(0.5)).abs() < 1e-12);
    }
}
