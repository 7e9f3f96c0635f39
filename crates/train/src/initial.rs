//! What training starts from: Gaussians at the points of a dataset, or at random where its cameras look.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use instgs_vk::math::nearest::PointSet;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::SH_C0;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Camera, Gaussians, PointCloud};

use super::config::TrainConfig;

/// Number of nearest neighbours that decide the size of a Gaussian.
const NEIGHBOURS: usize = 3;
/// Smallest mean squared distance to the neighbours, square scene units, for points that coincide.
const MIN_SQUARED_DISTANCE: f64 = 1e-7;
/// INRIA's margin around the cameras in the scene extent.
const EXTENT_MARGIN: f64 = 1.1;
/// Upper bound of draws of a random point until a camera sees it.
const TRIES: usize = 64;
/// Least depth at which a camera sees a random point, in half sides of the box.
const MIN_DEPTH: f64 = 0.02;

/// Opacity and size of the first Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InitialShape {
    /// Opacity of each, in 0..1 without the ends.
    pub opacity: f64,
    /// Factor on the standard deviation that the neighbours give, above 0.
    pub scale: f64,
}

impl InitialShape {
    /// The shape from the keys `init_opacity` and `init_scale`.
    pub fn new(config: &TrainConfig) -> Self {
        Self { opacity: config.init_opacity, scale: config.init_scale }
    }
}

/// One Gaussian per point, in the same order, with the point's colour as SH coefficient 0 (`(rgb - 0.5) / C0`) and the
/// other coefficients 0. It is round; its standard deviation is `shape.scale` times the root mean square distance to
/// the three nearest other points (all others if there are fewer; at least sqrt(1e-7) scene units); its opacity is
/// `shape.opacity`. Positions must be finite. The same points give the same bits.
pub fn from_points(points: &PointCloud, sh_degree: u32, shape: InitialShape) -> Gaussians {
    let mut out = Gaussians::with_capacity(sh_degree, points.len());
    let logit = (shape.opacity / (1.0 - shape.opacity)).ln() as f32;
    let log_factor = shape.scale.ln();
    for (squared, (position, color)) in
        mean_squared_distances(&points.positions).into_iter().zip(points.positions.iter().zip(&points.colors))
    {
        out.means.push(*position);
        out.quats.push([1.0, 0.0, 0.0, 0.0]);
        out.log_scales.push([(0.5 * squared.max(MIN_SQUARED_DISTANCE).ln() + log_factor) as f32; 3]);
        out.opacity_logits.push(logit);
        out.sh.push(color.map(|c| ((f64::from(c) / 255.0 - 0.5) / SH_C0) as f32));
        out.sh.resize(out.means.len() * sh_coefficients(sh_degree), [0.0; 3]);
    }
    out
}

/// Mean of the squared distances of each point to its three nearest others, square scene units; 0 for a point alone.
fn mean_squared_distances(positions: &[[f32; 3]]) -> Vec<f64> {
    let set = PointSet::new(positions);
    positions.par_iter().map(|&p| set.mean_squared_distance_to_others(p, NEIGHBOURS)).collect()
}

/// `count` Gaussians as from [`from_points`], at random positions that at least one camera sees and with random
/// colours, for datasets without points. Positions are uniform in the visible part of a cube; a point that no camera
/// sees after 64 draws stays where the last draw put it. `cameras` must not be empty.
///
/// The cube: if the cameras look at a common point (the point nearest to all optical axes lies in front of more than
/// half of them), it is centred there, and its half side is the largest distance of a camera from their mean, or half
/// the median distance of that point if that is larger. Otherwise (a room seen from within, parallel axes, one camera)
/// it is centred on the cameras, with three times the largest distance of a camera from their mean as half side; a
/// distance of 0 counts as 1.
pub fn random_in_view(cameras: &[Camera], count: usize, seed: u64, sh_degree: u32, shape: InitialShape) -> Gaussians {
    let (centre, half_side) = region_in_view(cameras);
    let mut rng = Rng::new(seed);
    let mut points = PointCloud::default();
    for _ in 0..count {
        let mut place = centre;
        for _ in 0..TRIES {
            let mut axis = || rng.range(-half_side, half_side);
            place = centre + DVec3::new(axis(), axis(), axis());
            if cameras.iter().any(|c| sees(c, place, MIN_DEPTH * half_side)) {
                break;
            }
        }
        points.positions.push(place.as_vec3().to_array());
        let color = rng.next_u32().to_le_bytes();
        points.colors.push([color[0], color[1], color[2]]);
    }
    from_points(&points, sh_degree, shape)
}

/// Centre and half side of the cube of [`random_in_view`].
fn region_in_view(cameras: &[Camera]) -> (DVec3, f64) {
    let (mean, spread) = mean_and_spread(cameras);
    if let Some(focus) = focus(cameras) {
        let mut depths: Vec<f64> = cameras.iter().map(|c| depth(c, focus)).collect();
        let middle = depths.len() / 2;
        let median = *depths.select_nth_unstable_by(middle, f64::total_cmp).1;
        let before = cameras.iter().filter(|c| depth(c, focus) > 0.0).count();
        if 2 * before > cameras.len() {
            return (focus, spread.max(0.5 * median));
        }
    }
    (mean, 3.0 * if is_apart(mean, spread) { spread } else { 1.0 })
}

/// The point with the least sum of squared distances to the optical axes; `None` if they are nearly parallel.
fn focus(cameras: &[Camera]) -> Option<DVec3> {
    let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let forward = camera.rotation().row(2);
        let across = DMat3::IDENTITY - DMat3::from_cols(forward * forward.x, forward * forward.y, forward * forward.z);
        matrix += across;
        right += across * camera.position_world();
    }
    // For two axes at an angle a the determinant is about a^2 / 4 (per camera): 1e-4 is about one degree.
    let per_camera = matrix.determinant() / (cameras.len() as f64).powi(3);
    (per_camera > 1e-4).then(|| matrix.inverse() * right)
}

fn depth(camera: &Camera, place: DVec3) -> f64 {
    camera.view_from_point(place).z
}

fn sees(camera: &Camera, place: DVec3, min_depth: f64) -> bool {
    depth(camera, place) > min_depth && camera.pixel_of(place).is_some_and(|at| camera.has_pixel(at))
}

/// The mean of the camera centres, and the largest distance of a camera from it; scene units.
fn mean_and_spread(cameras: &[Camera]) -> (DVec3, f64) {
    let centres: Vec<DVec3> = cameras.iter().map(Camera::position_world).collect();
    let mean = centres.iter().sum::<DVec3>() / centres.len().max(1) as f64;
    (mean, centres.iter().map(|c| c.distance(mean)).fold(0.0, f64::max))
}

/// False if cameras within `spread` of `mean` are in one place, apart from rounding.
fn is_apart(mean: DVec3, spread: f64) -> bool {
    spread > 1e-6 * mean.length().max(1.0)
}

/// The scene extent in scene units, as INRIA defines it: 1.1 times the largest distance of a camera from the mean of
/// all. It scales learning rates of positions and thresholds of sizes. If all cameras are in one place it is the
/// distance from there to the median of `points`, or 1 if that is 0 or there are no points.
pub fn scene_extent(cameras: &[Camera], points: &PointCloud) -> f64 {
    let (mean, spread) = mean_and_spread(cameras);
    if is_apart(mean, spread) {
        return EXTENT_MARGIN * spread;
    }
    let distance = points.median().map_or(0.0, |median| median.distance(mean));
    if is_apart(mean, distance) { distance } else { 1.0 }
}

#[cfg(test)]
#[path = "initial_tests.rs"]
mod tests;
