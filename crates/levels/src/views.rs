//! Cameras around a template, at the distances from which a level is shown.

use glam::DVec3;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::{Camera, Gaussians};

/// Focal length of the views, pixels: that of a picture 640 pixels wide with 56 degrees from side to side.
const FOCAL_PX: f64 = 600.0;
/// Cameras are at least this many radii from the centre.
const NEAREST: f64 = 2.0;
/// Longest side of a view, pixels. What is larger is seen in parts.
pub(crate) const MOST_PX: u32 = 160;
/// Shortest side of a view, pixels.
const LEAST_PX: f64 = 16.0;
/// Pixels around the ball: splats reach beyond their means.
const MARGIN_PX: f64 = 4.0;
/// Range of the width of a level's cells in the views, pixels. Errors of 1 and 2 px are usual, at which a level is shown with
/// cells of 0.5 to 2 px. From larger pictures it learns more, also for smaller ones: 50,000 Gaussians of random colours, trained
/// with cells of 0.5 to 1 px, were 44.2 and 32.3 dB from the full picture at errors of 1 and 2 px, with 0.7 to 2 px 45.1 and 36.9,
/// with 1 to 2 px 44.9 and 37.6 (by merging 40.7 and 31.7).
const CELL_PX: [f64; 2] = [0.7, 2.0];

/// A view of a template, with what is behind the template.
#[derive(Clone, Debug)]
pub(crate) struct FitView {
    /// The camera, in the template's frame.
    pub(crate) camera: Camera,
    /// Colour behind the template, so that its transparency is seen, too.
    pub(crate) background: [f32; 3],
    /// Nothing of the template is nearer than this, template units.
    pub(crate) near: f32,
}

/// A ball that contains a template's Gaussians.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball {
    /// Middle of the box around the means, template units.
    pub(crate) center: DVec3,
    /// Largest distance of a mean from the centre, template units.
    pub(crate) radius: f64,
}

impl Ball {
    /// The ball around the finite means of a cloud; `None` without any, or if all are in one place.
    pub(crate) fn around(cloud: &Gaussians) -> Option<Self> {
        let means: Vec<DVec3> =
            cloud.means.iter().map(|&m| glam::Vec3::from(m).as_dvec3()).filter(|m| m.is_finite()).collect();
        let low = means.iter().copied().reduce(DVec3::min)?;
        let high = means.iter().copied().reduce(DVec3::max)?;
        let center = 0.5 * (low + high);
        let radius = means.iter().map(|m| m.distance(center)).fold(0.0, f64::max);
        (radius > 0.0).then_some(Self { center, radius })
    }
}

/// What views of a level must show.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LevelSize {
    /// A ball around the template.
    pub(crate) ball: Ball,
    /// Side of the level's cells, template units.
    pub(crate) cell: f64,
}

/// `count` views of a template from directions all around it. Of one that is too large for a picture, each shows the
/// surroundings of one of the level's Gaussians, drawn at random.
pub(crate) fn views_around(size: LevelSize, level: &Gaussians, count: usize, rng: &mut Rng) -> Vec<FitView> {
    (0..count).map(|_| view(size, level, rng)).collect()
}

fn view(LevelSize { ball, cell }: LevelSize, level: &Gaussians, rng: &mut Rng) -> FitView {
    let px_per_unit = CELL_PX[0] * (CELL_PX[1] / CELL_PX[0]).powf(rng.uniform()) / cell;
    let distance = (FOCAL_PX / px_per_unit).max(NEAREST * ball.radius);
    let focal = px_per_unit * distance;
    let direction = rng.unit_vector();
    let up = direction.any_orthonormal_vector();
    let eye = ball.center + distance * direction;
    // The near side of the ball is larger on the screen than its middle.
    let radius_px = focal * ball.radius / (distance * distance - ball.radius * ball.radius).sqrt() + MARGIN_PX;
    let side = (2.0 * radius_px).ceil().clamp(LEAST_PX, f64::from(MOST_PX));
    let size = (side as u32, side as u32);
    let centred = Camera { fx: focal, fy: focal, ..Camera::look_at("level", eye, ball.center, up, 1.0, size) };
    // The picture moves over the ball until a Gaussian is in its middle, but not past the ball's border.
    let slack = (radius_px - 0.5 * side).max(0.0);
    let aim = glam::Vec3::from(level.means[rng.index(level.len())]).as_dvec3();
    let [x, y] = centred.pixel_of(aim).unwrap_or([centred.cx, centred.cy]);
    let moved = |middle: f64, at: f64| middle + (middle - at).clamp(-slack, slack);
    let camera = Camera { cx: moved(centred.cx, x), cy: moved(centred.cy, y), ..centred };
    FitView { camera, background: [0; 3].map(|_| rng.uniform() as f32), near: (0.1 * (distance - ball.radius)) as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball of `count` Gaussians of radius 3 around (1, 2, 3).
    fn ball(count: usize) -> Gaussians {
        let mut rng = Rng::new(1);
        let mut cloud = Gaussians::default();
        for _ in 0..count {
            let at = DVec3::new(1.0, 2.0, 3.0) + 3.0 * rng.unit_vector();
            cloud.means.push(at.as_vec3().to_array());
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([-3.0; 3]);
            cloud.opacity_logits.push(0.0);
            cloud.sh.push([0.0; 3]);
        }
        cloud
    }

    #[test]
    fn cells_have_their_size_on_the_screen_and_small_templates_are_seen_whole() {
        let cloud = ball(500);
        let around = Ball::around(&cloud).unwrap_or(Ball { center: DVec3::ZERO, radius: 0.0 });
        assert!((around.radius - 3.0).abs() < 0.1 && around.center.distance(DVec3::new(1.0, 2.0, 3.0)) < 0.3);
        for cell in [0.01, 0.1, 1.0] {
            let views = views_around(LevelSize { ball: around, cell }, &cloud, 100, &mut Rng::new(2));
            let (mut small, mut large) = (f64::INFINITY, 0.0f64);
            for FitView { camera, near, .. } in &views {
                camera.validate().unwrap_or_else(|error| panic!("{error}"));
                let depth = camera.view_from_point(around.center).z;
                assert!(f64::from(*near) < depth - around.radius && depth >= NEAREST * around.radius * 0.999);
                let cell_px = cell * camera.fx / depth;
                (small, large) = (small.min(cell_px), large.max(cell_px));
                let seen = cloud.means.iter().filter(|mean| {
                    let at = camera.pixel_of(glam::Vec3::from(**mean).as_dvec3());
                    at.is_some_and(|at| camera.has_pixel(at))
                });
                let seen = seen.count();
                let is_whole = 6.0 / cell * 2.0 + 2.0 * MARGIN_PX < f64::from(MOST_PX);
                assert!(seen > 0 && (!is_whole || seen == cloud.len()), "{seen} of {} at {cell}", cloud.len());
                assert!(camera.width <= MOST_PX && camera.width == camera.height);
            }
            assert!(small >= 0.999 * CELL_PX[0] && large <= 1.001 * CELL_PX[1], "{small} {large}");
            assert!(small < 1.1 * CELL_PX[0] && large > 0.9 * CELL_PX[1], "{small} {large}");
        }
    }

    #[test]
    fn clouds_without_extent_have_no_ball() {
        assert!(Ball::around(&Gaussians::default()).is_none());
        let mut cloud = ball(3);
        cloud.means = vec![[1.0; 3]; 3];
        assert!(Ball::around(&cloud).is_none());
        cloud.means = vec![[1.0; 3], [f32::NAN; 3], [2.0, 1.0, 1.0]];
        assert!(Ball::around(&cloud).is_some_and(|ball| (ball.radius - 0.5).abs() < 1e-9));
    }
}
