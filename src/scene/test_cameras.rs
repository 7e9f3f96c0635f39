//! Cameras for unit tests.

use glam::DVec3;

use super::camera::Camera;

/// Twelve cameras on a ring of radius 9 around the origin, 4 above it, looking at it with `up` upwards.
pub(crate) fn ring(up: DVec3) -> Vec<Camera> {
    let eye = |i: u32| DVec3::new(9.0 * f64::from(i).cos(), 9.0 * f64::from(i).sin(), 4.0);
    (0..12).map(|i| Camera::look_at("", eye(i), DVec3::ZERO, up, 0.8, (64, 48))).collect()
}
