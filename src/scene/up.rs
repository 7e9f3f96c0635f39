//! Which way is up, as far as photos tell.

use glam::DVec3;

use super::camera::Camera;

/// The direction that is up in the pictures, world frame: the mean of the cameras' up, if they agree on it at all.
pub fn up_direction(cameras: &[Camera]) -> Option<DVec3> {
    let sum: DVec3 = cameras.iter().map(|c| -c.rotation().row(1)).filter(|up| up.is_finite()).sum();
    // Cameras turned every which way add up to less than this part of their number.
    let agree = sum.length() > 0.3 * cameras.len() as f64;
    agree.then(|| sum.normalize_or_zero()).filter(|up| *up != DVec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::test_cameras::ring;

    #[test]
    fn up_is_what_pictures_agree_on() {
        let up = up_direction(&ring(DVec3::Z)).unwrap();
        assert!(up.dot(DVec3::Z) > 0.99, "{up}");
        let mut turned = ring(DVec3::Z);
        turned.extend(ring(DVec3::NEG_Z));
        assert!(up_direction(&turned).is_none() && up_direction(&[]).is_none());
    }
}
