//! Cameras for tests.

use glam::DVec3;

use super::camera::Camera;

/// Twelve cameras around the origin, 9 units from the vertical through it and 4 above it, that look at it; held so that
/// `up` is up.
pub(crate) fn ring(up: DVec3) -> Vec<Camera> {
    let eye = |i: u32| DVec3::new(9.0 * f64::from(i).cos(), 9.0 * f64::from(i).sin(), 4.0);
    (0..12).map(|i| Camera::look_at("", eye(i), DVec3::ZERO, up, 0.8, (64, 48))).collect()
}
