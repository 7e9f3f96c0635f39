//! Twin of kernel `tile_marks`: the nearest splat whose mark covers a pixel, in f64.

use crate::preprocess_instance_expand::{ALPHA_MIN as LEAST_ALPHA, ProjectedSplat, pixel_center};
use crate::tile_blend::{ALPHA_MIN_MARGIN as ALPHA_MARGIN, candidate_boxes, near_at_risk, order_at_risk};
use crate::view::View;

/// The shape that marks a splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MarkShape {
    /// A disc of 1.5 pixels around the centre.
    Points,
    /// The ellipse of one standard deviation, clipped to alpha of at least this.
    Ellipses(f64),
}

/// Radius of a point's disc, pixels.
const POINT_RADIUS_PX: f64 = 1.5;
/// Factor on the colour at the rim.
const RIM: f64 = 0.35;
/// A pixel is not robust within this relative distance of a mark's rim, since the conics of needles lose two or three
/// of f32's seven digits.
const RIM_MARGIN: f64 = 1e-3;

/// The mark at one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// Red, green and blue, levels 0 to 255 before rounding; `None` without a mark.
    pub levels: Option<[f64; 3]>,
    /// Whether f32 must take the same decisions.
    pub robust: bool,
}

/// The marks of all pixels of the view, row by row. `splats` are in depth order.
pub fn marks(view: &View, splats: &[ProjectedSplat], shape: MarkShape) -> Vec<Mark> {
    let boxes = candidate_boxes(view, splats);
    let at = |i: u32| mark_at(view, splats, &boxes, shape, [i % view.width, i / view.width]);
    (0..view.width * view.height).map(at).collect()
}

fn mark_at(view: &View, splats: &[ProjectedSplat], boxes: &[[u32; 4]], shape: MarkShape, [x, y]: [u32; 2]) -> Mark {
    let mut out = Mark { levels: None, robust: true };
    let alpha_min = match shape {
        MarkShape::Points => LEAST_ALPHA,
        MarkShape::Ellipses(alpha) => alpha.max(LEAST_ALPHA),
    };
    let mut taken: Option<&ProjectedSplat> = None;
    for (splat, &[x0, x1, y0, y1]) in splats.iter().zip(boxes) {
        if !((x0..x1).contains(&x) && (y0..y1).contains(&y)) {
            continue;
        }
        let at = pixel_center(x, y);
        // Alpha relative to the smallest that is drawn.
        let (reach, alpha) = (reach(splat, shape, at), splat.alpha_at(at) / alpha_min);
        if reach > 1.0 + RIM_MARGIN || alpha < 1.0 - ALPHA_MARGIN {
            continue;
        }
        if let Some(taken) = taken {
            // Ordered first, this splat would be the mark.
            if order_at_risk(taken, splat) {
                out.robust = false;
                continue;
            }
            return out;
        }
        let close = (reach - 1.0).abs() <= RIM_MARGIN || (alpha - 1.0).abs() <= ALPHA_MARGIN;
        out.robust &= !close && !near_at_risk(splat, view.options.near);
        if splat.depth > view.options.near && reach <= 1.0 && alpha >= 1.0 {
            let shade = 1.0 - (1.0 - RIM) * reach;
            out.levels = Some(splat.color.to_array().map(|c| 255.0 * c.min(1.0) * shade));
            taken = Some(splat);
        }
    }
    out
}

/// Square of the distance from the mark's centre; 1 at its rim.
fn reach(splat: &ProjectedSplat, shape: MarkShape, at: glam::DVec2) -> f64 {
    match shape {
        MarkShape::Points => at.distance_squared(splat.mean_px) / (POINT_RADIUS_PX * POINT_RADIUS_PX),
        MarkShape::Ellipses(_) => 2.0 * splat.sigma_at(at),
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::preprocess_instance_expand::sources;
    use crate::tile_blend::relaxed_limits;
    use crate::{RenderOptions, splats_in_depth_order};
    use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

    /// A red Gaussian in front of a green one that is twice as wide on the screen, standard deviations of 2 and 4 px
    /// before dilation; and a white one in front of both, which is too faint for an ellipse.
    fn marks_of(shape: MarkShape) -> Vec<Mark> {
        let mut cloud = Gaussians::with_capacity(0, 3);
        let camera = Camera::look_at("view", DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 1.0, (15, 15));
        let red = (1.0, 2.0, [1.0, -5.0, -5.0], 0.0);
        let green = (4.0, 4.0, [-5.0, 1.0, -5.0], 3.0);
        let faint = (0.5, 6.0, [2.0; 3], -2.5);
        for (z, sigma_px, sh, logit) in [faint, red, green] {
            cloud.means.push([0.0, 0.0, z]);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([(sigma_px * z / camera.fx as f32).ln(); 3]);
            cloud.opacity_logits.push(logit);
            cloud.sh.push(sh);
        }
        let scene = InstancedScene::from_cloud(cloud);
        let view = View::device(&camera, &RenderOptions::default());
        let splats = splats_in_depth_order(&sources(&scene), &view, &relaxed_limits(&view));
        assert_eq!(splats.len(), 3);
        marks(&view, &splats, shape)
    }

    #[test]
    fn the_nearest_mark_wins_and_darkens_towards_its_rim() {
        let row = |marks: Vec<Mark>| marks[7 * 15..8 * 15].to_vec();
        let ellipses = row(marks_of(MarkShape::Ellipses(0.1)));
        let points = row(marks_of(MarkShape::Points));
        let is_red = |mark: &Mark| mark.levels.is_some_and(|[r, g, _]| r > 60.0 && g == 0.0);
        let is_green = |mark: &Mark| mark.levels.is_some_and(|[r, g, _]| g > 60.0 && r == 0.0);
        assert!(ellipses[5..10].iter().all(is_red) && ellipses[3..5].iter().all(is_green), "{ellipses:?}");
        assert!(ellipses[..3].iter().all(|mark| mark.levels.is_none()));
        assert!(ellipses[7].levels.unwrap()[0] > 2.0 * ellipses[5].levels.unwrap()[0]);
        let is_white = |mark: &Mark| mark.levels.is_some_and(|[r, g, b]| r > 60.0 && r == g && g == b);
        assert!(points[6..9].iter().all(is_white) && points[5].levels.is_none() && points[7].robust);
    }
}
