//! Points on an object's surface, evenly spread, at several resolutions.

use glam::DVec3;

use crate::math::nearest::PointSet;

/// A point that was drawn on a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    /// Local frame: world axes, origin at the object's centroid.
    pub position: DVec3,
    /// Towards the cameras; its length, 0..=1, says how flat the Gaussian is.
    pub normal: DVec3,
    /// Base colour, rgb.
    pub color: DVec3,
}

/// Points about one voxel apart.
pub(super) struct Surface {
    /// Size of the voxels, scene units.
    pub voxel: f64,
    /// Local frame.
    pub positions: Vec<DVec3>,
    /// Mean of the samples' normals: shorter than 1 where they disagree or are of round Gaussians.
    pub normals: Vec<DVec3>,
    /// Base colours, rgb.
    pub colors: Vec<DVec3>,
    /// To search among `positions`.
    pub set: PointSet,
}

impl Surface {
    /// The mean sample of every voxel that has any, in order of voxels. Samples must be finite.
    pub(super) fn new(samples: &[Sample], voxel: f64) -> Self {
        let key = |p: DVec3| (p / voxel).floor().to_array().map(|c| c as i64);
        let mut order: Vec<([i64; 3], usize)> = samples.iter().enumerate().map(|(i, s)| (key(s.position), i)).collect();
        order.sort_unstable();
        let (mut positions, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
        for cell in order.chunk_by(|a, b| a.0 == b.0) {
            let mean = |of: fn(&Sample) -> DVec3| {
                cell.iter().map(|&(_, i)| of(&samples[i])).sum::<DVec3>() / cell.len() as f64
            };
            positions.push(mean(|s| s.position));
            normals.push(mean(|s| s.normal));
            colors.push(mean(|s| s.color));
        }
        let set = PointSet::new(&positions.iter().map(|p| p.as_vec3().to_array()).collect::<Vec<_>>());
        Self { voxel, positions, normals, colors, set }
    }

    /// Number of points.
    pub(super) fn len(&self) -> usize {
        self.positions.len()
    }

    /// The point nearest to `position` and its distance; `None` if there are no points.
    pub(super) fn nearest(&self, position: DVec3) -> Option<(usize, f64)> {
        let near = self.set.nearest_one(position.as_vec3().to_array())?;
        Some((near.index as usize, near.squared_distance.sqrt()))
    }

    /// Its points as samples.
    pub(super) fn samples(&self) -> Vec<Sample> {
        let parts = self.positions.iter().zip(&self.normals).zip(&self.colors);
        parts.map(|((&position, &normal), &color)| Sample { position, normal, color }).collect()
    }
}

/// The largest distance of a point from the origin of the local frame; above 0.
pub(super) fn reach_of(surface: &Surface) -> f64 {
    surface.positions.iter().map(|p| p.length()).fold(f64::MIN_POSITIVE, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    #[test]
    fn a_voxel_holds_the_mean_of_its_samples() {
        let at = |x: f64, shade: f64| Sample {
            position: DVec3::new(x, 0.5, 0.5),
            normal: DVec3::Z,
            color: DVec3::splat(shade),
        };
        let surface = Surface::new(&[at(0.2, 1.0), at(-0.5, 7.0), at(0.6, 3.0)], 1.0);
        assert_eq!(surface.positions, [DVec3::new(-0.5, 0.5, 0.5), DVec3::new(0.4, 0.5, 0.5)]);
        assert_eq!(surface.colors, [DVec3::splat(7.0), DVec3::splat(2.0)]);
        assert_eq!(surface.nearest(DVec3::new(-2.5, 0.5, 0.5)), Some((0, 2.0)));
        assert!(Surface::new(&[], 1.0).nearest(DVec3::ZERO).is_none());
    }

    #[test]
    fn the_order_of_samples_hardly_matters() {
        let mut rng = Rng::new(1);
        let mut draw = || Sample { position: rng.normal_vector(), normal: DVec3::Z, color: DVec3::ZERO };
        let mut samples: Vec<Sample> = (0..500).map(|_| draw()).collect();
        let a = Surface::new(&samples, 0.5);
        samples.reverse();
        let b = Surface::new(&samples, 0.5);
        assert!(a.len() == b.len() && a.len() < 500);
        assert!(a.positions.iter().zip(&b.positions).all(|(p, q)| p.distance(*q) < 1e-14));
    }
}
