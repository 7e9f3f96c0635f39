//! What of a scene a view may show, computed on the host: which pages of a background it wants is decided before a frame.

use glam::DVec3;

use crate::scene::Camera;
use crate::scene::lod::NO_NEXT_CELL;
use crate::scene::lod::pages::Ball;

use super::render_options::RenderOptions;

/// Reach of a splat in standard deviations, as in kernel `cull_instances`, with a margin for f32.
const EXTENT_SIGMAS: f64 = 3.4;
/// The Jacobian is clamped where directions are further from the axis than this times the border of the picture.
const CLAMPED_BEYOND: f64 = 1.4;
/// A view, for tests of balls on the host that keep whatever `cull_instances` keeps.
pub(super) struct Frustum {
    view_from_world: [[f64; 4]; 3],
    near: f64,
    focal_px: f64,
    /// Inner normals of the borders of the picture, each times a length, and what is added for each unit of a standard deviation.
    borders: [(DVec3, f64); 4],
}

impl Frustum {
    pub(super) fn of(camera: &Camera, options: &RenderOptions) -> Self {
        let border = 1.0 + EXTENT_SIGMAS * f64::from(options.dilation_px2).sqrt();
        let side = |focal: f64, principal: f64, size: u32| {
            let size = f64::from(size);
            let limit = CLAMPED_BEYOND * principal.max(size - principal).abs() / focal;
            (EXTENT_SIGMAS * focal * (1.0 + limit * limit).sqrt(), principal + border, size - principal + border)
        };
        let ((of_x, left, right), (of_y, top, bottom)) =
            (side(camera.fx, camera.cx, camera.width), side(camera.fy, camera.cy, camera.height));
        let m = &camera.view_from_world;
        Self {
            view_from_world: [m[0], m[1], m[2]],
            near: options.near.into(),
            focal_px: camera.fx.max(camera.fy),
            borders: [
                (DVec3::new(camera.fx, 0.0, left), of_x),
                (DVec3::new(-camera.fx, 0.0, right), of_x),
                (DVec3::new(0.0, camera.fy, top), of_y),
                (DVec3::new(0.0, -camera.fy, bottom), of_y),
            ],
        }
    }

    fn in_view(&self, ball: &Ball) -> DVec3 {
        let [x, y, z] = [ball[0], ball[1], ball[2]].map(f64::from);
        DVec3::from_array(self.view_from_world.map(|m| m[0] * x + m[1] * y + m[2] * z + m[3]))
    }

    /// False only if no splat of the ball can change a pixel.
    pub(super) fn may_show(&self, ball: &Ball) -> bool {
        let center = self.in_view(ball);
        let slack = self.slack(ball, center);
        let (radius, sigma) = (1.01 * f64::from(ball[3]) + slack, 1.02 * f64::from(ball[4]));
        center.z + radius > self.near
            && self
                .borders
                .iter()
                .all(|(normal, reach)| normal.dot(center) + normal.length() * radius + reach * sigma > 0.0)
    }

    /// Several times what f32 makes of the large coordinates of a ball.
    fn slack(&self, ball: &Ball, in_view: DVec3) -> f64 {
        let in_world = ball[0].abs().max(ball[1].abs()).max(ball[2].abs());
        4e-5 * (in_view.abs().max_element() + f64::from(in_world))
    }

    /// Pixels that a cell is wide at the nearest point of a ball; 0 if the ball is out of view.
    pub(super) fn cell_px(&self, ball: &Ball, cell: f32) -> f64 {
        if !self.may_show(ball) {
            return 0.0;
        }
        let center = self.in_view(ball);
        let nearest = (center.z - f64::from(ball[3]) - self.slack(ball, center)).max(self.near).max(1e-9);
        // What cannot be merged is as wide as its block.
        let wide = if cell >= NO_NEXT_CELL { 2.0 * f64::from(ball[3]) + f64::from(ball[4]) } else { cell.into() };
        (self.focal_px * wide / nearest).max(f64::MIN_POSITIVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    /// Whatever has its middle in the picture may be shown, alone or in a ball around it; what is behind or far beside is not, and
    /// the width of a cell is that at the nearest point.
    #[test]
    fn what_is_in_the_picture_may_be_shown() {
        let mut rng = Rng::new(9);
        let options = RenderOptions::default();
        let (mut shown, mut hidden) = (0, 0);
        for _ in 0..200 {
            let mut at = || DVec3::from_array([0; 3].map(|_| rng.range(-5.0, 5.0)));
            let (eye, target) = (at(), at());
            let camera = Camera::look_at("a", eye, target, DVec3::new(0.1, 0.9, 0.3), 0.9, (80, 50));
            let view = Frustum::of(&camera, &options);
            for _ in 0..100 {
                let mean = DVec3::from_array([0; 3].map(|_| rng.range(-8.0, 8.0)));
                let offset = DVec3::from_array([0; 3].map(|_| rng.range(-0.5, 0.5)));
                let ball = |center: DVec3, radius: f64| {
                    let [x, y, z] = center.as_vec3().to_array();
                    [x, y, z, radius as f32, 0.01]
                };
                let in_view = view.in_view(&ball(mean, 0.0));
                let at = [camera.fx * in_view.x, camera.fy * in_view.y].map(|v| v / in_view.z);
                let is_inside = camera.has_pixel([at[0] + camera.cx, at[1] + camera.cy]) && in_view.z > 0.2;
                let (alone, around) = (ball(mean, 0.0), ball(mean + offset, offset.length() + 1e-6));
                if is_inside {
                    shown += 1;
                    assert!(view.may_show(&alone) && view.may_show(&around));
                    let exact = camera.fx.max(camera.fy) * 0.5 / in_view.z;
                    assert!(view.cell_px(&around, 0.5) >= 0.999 * exact);
                } else if in_view.z < -0.1 || at[0].abs() > 200.0 {
                    hidden += 1;
                    assert!(!view.may_show(&alone) && view.cell_px(&alone, 0.5) == 0.0);
                }
            }
        }
        assert!(shown > 1000 && hidden > 1000, "{shown} {hidden}");
    }
}
