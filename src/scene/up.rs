//! Estimates the up axis of a scene from its cameras.

use glam::{DMat3, DVec3};

use super::camera::Camera;
use crate::math::eigen::symmetric_eigen;

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

#[cfg(test)]
mod tests {
    use super::*;
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
}
