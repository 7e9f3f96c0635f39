//! Estimates the up axis of a scene from its cameras.

use glam::{DMat3, DVec3};

use super::camera::Camera;
use crate::math::eigen::symmetric_eigen;
use crate::math::sh::widened;
use crate::math::statistics::median;

/// Weight of the prior, the mean of the cameras' up vectors, per camera. Cameras are level within some degrees, about
/// 0.001 in squared sine; where the view directions span less than 8 degrees, below 0.02, the prior decides.
const MEAN_WEIGHT: f64 = 0.02;

/// The up axis, a unit vector in the world frame: the direction most perpendicular to the cameras' x axes, near the
/// mean of their up vectors. `None` if these do not agree. The mean alone would lean if all cameras look down from one
/// side; their x axes stay level.
pub fn up_direction(cameras: &[Camera]) -> Option<DVec3> {
    let sum: DVec3 = cameras.iter().map(|c| -c.rotation().row(1)).filter(|up| up.is_finite()).sum();
    // The sum of random up vectors stays below this part of their number.
    let agree = sum.length() > 0.3 * cameras.len() as f64;
    let mean = agree.then(|| sum.normalize_or_zero()).filter(|up| *up != DVec3::ZERO)?;
    let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
    let prior = (DMat3::IDENTITY - outer(mean)) * MEAN_WEIGHT * cameras.len() as f64;
    let sideways = cameras.iter().map(|c| c.rotation().row(0)).filter(|right| right.is_finite());
    let level = sideways.map(outer).fold(prior, |sum, right| sum + right);
    let (_, least) = symmetric_eigen(level.to_cols_array_2d())[0];
    let up = DVec3::from_array(least);
    Some(if up.dot(mean) < 0.0 { -up } else { up })
}

/// Axes that differ by more than this, radians (20 degrees), are not one: cameras are level to some degrees, and ground slopes.
const ANOTHER_AXIS: f64 = 0.35;

/// Axes that may be up: unit vectors of the world frame. Which one is tells what stands there: on a flight over a car park the cars
/// stand upright about `straight`, on a shelf, which cameras look straight at as well, goods do about `level`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpAxes {
    /// The axis that the cameras agree on: [`up_direction`].
    pub level: Option<DVec3>,
    /// The normal, towards the cameras, of the plane in which the points roughly lie, if the cameras look straight at it, as on a flight
    /// over a field or along a facade, and if it is another axis. The upper edges of such pictures may point anywhere within the
    /// plane: `level` of a flight is the north.
    pub straight: Option<DVec3>,
}

impl UpAxes {
    /// Of cameras and the points that they see, in the world frame. Points are not asked for if the cameras look into all directions.
    pub fn of(cameras: &[Camera], points: impl IntoIterator<Item = [f32; 3]>) -> Self {
        let level = up_direction(cameras);
        let straight = normal_seen_straight(cameras, points)
            .filter(|normal| level.is_none_or(|up| up.angle_between(*normal) > ANOTHER_AXIS));
        Self { level, straight }
    }
}

/// Points farther from their middle than this many times the median distance do not count: strays, and the horizon.
const FAR: f64 = 3.0;
/// Largest ratio of the standard deviations of the points along the normal of their plane and along its shorter side.
const FLAT: f64 = 0.5;
/// Least ratio of the variances along the shorter and the longer side: below it the points lie on a line, or in one place.
const WIDE: f64 = 1e-4;
/// Least mean cosine between the normal and the cameras' axes: 37 degrees from straight at it.
const STRAIGHT: f64 = 0.8;

/// [`UpAxes::straight`], even if it is no other axis than `level`.
fn normal_seen_straight(cameras: &[Camera], points: impl IntoIterator<Item = [f32; 3]>) -> Option<DVec3> {
    let forward = cameras.iter().map(|c| c.rotation().row(2)).filter(|axis| axis.is_finite());
    let forward = forward.sum::<DVec3>() / cameras.len().max(1) as f64;
    // The cosine below is no more than this.
    if forward.length() < STRAIGHT {
        return None;
    }
    let near = without_far(points.into_iter().map(widened).filter(|p| p.is_finite()).collect());
    let mean = near.iter().sum::<DVec3>() / near.len().max(1) as f64;
    let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
    let spread = near.iter().fold(DMat3::ZERO, |sum, &p| sum + outer(p - mean));
    let [(least, normal), (next, _), (most, _)] = symmetric_eigen(spread.to_cols_array_2d());
    let is_flat = least <= FLAT * FLAT * next && next > WIDE * most;
    let normal = DVec3::from_array(normal);
    let towards = -forward.dot(normal);
    (is_flat && towards.abs() >= STRAIGHT).then(|| normal * towards.signum())
}

/// The points that are not far from the middle of all.
fn without_far(mut points: Vec<DVec3>) -> Vec<DVec3> {
    let along = |axis: usize| median(&points.iter().map(|p| p[axis]).collect::<Vec<f64>>());
    let middle = DVec3::new(along(0), along(1), along(2));
    let limit = FAR * median(&points.iter().map(|p| p.distance(middle)).collect::<Vec<f64>>());
    points.retain(|p| p.distance(middle) <= limit);
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;
    use crate::scene::Camera;

    /// Cameras on a ring around the origin, above it, looking at it with `up` upwards.
    fn ring(up: DVec3) -> Vec<Camera> {
        let eye = |i: u32| DVec3::new(9.0 * f64::from(i).cos(), 9.0 * f64::from(i).sin(), 4.0);
        (0..12).map(|i| Camera::look_at("", eye(i), DVec3::ZERO, up, 0.8, (64, 48))).collect()
    }

    #[test]
    fn up_is_what_pictures_agree_on() {
        let up = up_direction(&ring(DVec3::Z)).unwrap();
        assert!(up.dot(DVec3::Z) > 0.99, "{up}");
        let mut turned = ring(DVec3::Z);
        turned.extend(ring(DVec3::NEG_Z));
        assert!(up_direction(&turned).is_none() && up_direction(&[]).is_none());
    }

    #[test]
    fn cameras_that_look_down_from_one_side_do_not_tilt_it() {
        let eye = |i: u32| DVec3::new(3.0 * (0.1 * f64::from(i)).cos(), 3.0 * (0.1 * f64::from(i)).sin(), 8.0);
        let side: Vec<Camera> =
            (0..12).map(|i| Camera::look_at("", eye(i), DVec3::ZERO, DVec3::Z, 0.8, (64, 48))).collect();
        let degrees = |up: DVec3| up.angle_between(DVec3::Z).to_degrees();
        // The mean of their up vectors leans by 70 degrees.
        let mean: DVec3 = side.iter().map(|c| -c.rotation().row(1)).sum();
        assert!(degrees(mean) > 60.0);
        assert!(degrees(up_direction(&side).unwrap()) < 30.0);
        // From a single direction only the mean is known.
        let still = vec![side[0].clone(); 5];
        assert!(degrees(up_direction(&still).unwrap()) > 60.0);
    }

    fn narrowed(point: DVec3) -> [f32; 3] {
        point.as_vec3().to_array()
    }

    /// A field of 40 by 20 with plants up to 1 high, and points on the horizon.
    fn field() -> Vec<[f32; 3]> {
        let mut rng = Rng::new(3);
        let mut draw = || DVec3::new(rng.range(0.0, 40.0), rng.range(0.0, 20.0), rng.range(0.0, 1.0));
        let mut points: Vec<DVec3> = (0..2000).map(|_| draw()).collect();
        points.extend((0..40).map(|i| DVec3::new(900.0, f64::from(i) * 20.0, 300.0)));
        points.into_iter().map(narrowed).collect()
    }

    /// Cameras above the field that look along a direction, with their upper edges along `up_of` each.
    fn flight(forward: DVec3, up_of: impl Fn(u32) -> DVec3) -> Vec<Camera> {
        let eye = |i: u32| DVec3::new(f64::from(i % 8) * 5.0, f64::from(i / 8) * 4.0, 15.0);
        let camera = |i: u32| Camera::look_at("", eye(i), eye(i) + forward, up_of(i), 0.9, (64, 48));
        (0..32).map(camera).collect()
    }

    #[test]
    fn flights_over_a_field_see_its_normal() {
        let north = flight(DVec3::NEG_Z, |_| DVec3::Y);
        let there_and_back = flight(DVec3::NEG_Z, |i| if (i / 8).is_multiple_of(2) { DVec3::X } else { DVec3::NEG_X });
        assert!(up_direction(&north).unwrap().z.abs() < 0.1 && up_direction(&there_and_back).is_none());
        for cameras in [north, there_and_back] {
            assert!(normal_seen_straight(&cameras, field()).unwrap().z > 0.999);
        }
    }

    /// The normal of a slope that cameras look down on from all sides is their axis.
    #[test]
    fn one_axis_is_not_two() {
        let slope: Vec<[f32; 3]> = field().into_iter().map(|[x, y, z]| [x, y, z - 0.1 * x]).collect();
        let sides = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
        let oblique = sides.map(|side| flight(0.6 * side - DVec3::Z, |_| DVec3::Z)).concat();
        assert!(normal_seen_straight(&oblique, slope.clone()).is_some());
        assert_eq!(UpAxes::of(&oblique, slope), UpAxes { level: up_direction(&oblique), straight: None });
        let north = UpAxes::of(&flight(DVec3::NEG_Z, |_| DVec3::Y), field());
        assert!(north.level.unwrap().y > 0.99 && north.straight.unwrap().z > 0.999);
    }

    /// Who looks along the ground, or at what is no plane, sees no normal.
    #[test]
    fn others_see_none() {
        let (level, down) = (flight(DVec3::X, |_| DVec3::Z), flight(DVec3::NEG_Z, |_| DVec3::Y));
        let mut rng = Rng::new(4);
        let ball: Vec<[f32; 3]> = (0..500).map(|_| narrowed(rng.unit_vector() * 9.0)).collect();
        let line: Vec<[f32; 3]> = (0..500_u16).map(|i| [0.0, f32::from(i), 0.0]).collect();
        let one = vec![[1.0; 3]; 9];
        let of_level = [field(), line.clone(), one.clone(), vec![[f32::NAN; 3]], Vec::new()].map(|p| (&level, p));
        let of_down = [ball, line, one, Vec::new()].map(|p| (&down, p));
        for (cameras, points) in of_level.into_iter().chain(of_down).chain([(&Vec::new(), field())]) {
            assert_eq!(normal_seen_straight(cameras, points), None);
        }
    }
}
