//! Normals of surface points, and the side they point to.

use glam::DVec3;

use super::surface::Surface;
use instgs_vk::math::eigen::symmetric_eigen;
use instgs_vk::scene::Camera;

/// If the mean of normals is shorter than this, they disagree or belong to round Gaussians, and a plane through the
/// neighbours is used. Three unit normals 70 degrees from their mean have 0.34.
const MIN_AGREEMENT: f64 = 0.35;
/// Neighbours that a plane is fitted to, the point itself included: the points in a disc of a radius of two voxels.
const NEIGHBOURS: usize = 13;

/// Weight of the direction out of the object relative to that to the cameras; it decides where cameras only graze the
/// surface.
const OUTWARDS: f64 = 0.3;

/// The cameras that see an object.
pub(super) struct Viewers {
    /// Camera centres, world frame.
    eyes: Vec<DVec3>,
    /// Centre of the object, world frame.
    centre: DVec3,
}

impl Viewers {
    /// The cameras whose picture contains the object's centre; all cameras if there are none.
    pub(super) fn new(cameras: &[Camera], centre: DVec3) -> Self {
        let seeing = cameras.iter().filter(|c| is_in_picture(c, centre));
        let mut eyes: Vec<DVec3> = seeing.map(Camera::position_world).collect();
        if eyes.is_empty() {
            eyes = cameras.iter().map(Camera::position_world).collect();
        }
        Self { eyes, centre }
    }

    /// Unit vector from a point of the object (world frame) towards its viewers: the mean direction to the cameras on
    /// its side of the object, weighted by the cosine to the way out, plus a little of the way out. Objects are assumed
    /// roughly convex, so a camera behind the object does not see the point.
    pub(super) fn direction(&self, position: DVec3) -> DVec3 {
        let outwards = (position - self.centre).normalize_or_zero();
        let towards = |eye: &DVec3| {
            let to_eye = (*eye - position).normalize_or_zero();
            to_eye * outwards.dot(to_eye).max(0.0)
        };
        let sum: DVec3 = self.eyes.iter().map(towards).sum();
        (sum.normalize_or_zero() + OUTWARDS * outwards).normalize_or_zero()
    }
}

fn is_in_picture(camera: &Camera, point: DVec3) -> bool {
    camera.pixel_of(point).is_some_and(|at| camera.has_pixel(at))
}

/// Unit normals of all points: the mean of the Gaussians' normals where they agree, else the normal of the neighbours'
/// plane, on the side of `direction`, which takes a local position.
pub(super) fn unit_normals(surface: &Surface, direction: impl Fn(DVec3) -> DVec3) -> Vec<DVec3> {
    let normal = |i: usize| {
        let mean = surface.normals[i];
        if mean.length() >= MIN_AGREEMENT {
            return mean.normalize();
        }
        let position = surface.positions[i];
        let near = surface.set.nearest(position.as_vec3().to_array(), NEIGHBOURS);
        let points: Vec<DVec3> = near.iter().map(|n| surface.positions[n.index as usize]).collect();
        let across = plane_normal(&points).unwrap_or(DVec3::Z);
        if across.dot(direction(position)) < 0.0 { -across } else { across }
    };
    (0..surface.len()).map(normal).collect()
}

/// Unit normal of the best plane through points; `None` if it is not finite.
fn plane_normal(points: &[DVec3]) -> Option<DVec3> {
    let (_, least) = symmetric_eigen(covariance(points))[0];
    Some(DVec3::from_array(least)).filter(|n| n.is_finite())
}

/// Covariance of points; NaN without points.
pub(super) fn covariance(points: &[DVec3]) -> [[f64; 3]; 3] {
    if points.is_empty() {
        return [[f64::NAN; 3]; 3];
    }
    let count = points.len() as f64;
    let mean = points.iter().sum::<DVec3>() / count;
    let mut out = [[0.0; 3]; 3];
    for d in points.iter().map(|p| *p - mean) {
        for (a, row) in out.iter_mut().enumerate() {
            row.iter_mut().enumerate().for_each(|(b, value)| *value += d[a] * d[b] / count);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::surface::Sample;
    use instgs_samples::ring;

    /// The normals of a ball point outwards, from flat Gaussians (whose sign the viewers give) and from neighbours.
    #[test]
    fn normals_of_a_ball_point_outwards() {
        let mut rng = instgs_vk::math::rng::Rng::new(1);
        let viewers = Viewers::new(&ring(DVec3::Z), DVec3::ZERO);
        let samples: Vec<Sample> = (0..4000)
            .map(|_| Sample { position: rng.unit_vector(), normal: DVec3::ZERO, color: DVec3::ZERO })
            .collect();
        let surface = Surface::new(&samples, 0.1);
        let normals = unit_normals(&surface, |p| viewers.direction(p));
        let worst = surface.positions.iter().zip(&normals).map(|(p, n)| p.normalize().dot(*n)).fold(1.0, f64::min);
        assert!(worst > 0.9, "{worst}");
        // Without cameras the object's centre decides.
        assert!(Viewers::new(&[], DVec3::ZERO).direction(DVec3::X * 2.0) == DVec3::X);
        assert!(Viewers::new(&[], DVec3::ZERO).direction(DVec3::ZERO) == DVec3::ZERO);
    }
}
