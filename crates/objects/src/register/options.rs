//! Options of registration.

use super::error::RegisterError;

/// Options of [`register`](super::register()).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegisterOptions {
    /// Whether scale is free (a similarity), for objects of several sizes. Off by default: objects of one kind in one
    /// reconstruction have one size, and a free scale hides a bad fit.
    pub allow_scale: bool,
    /// Gaussians of lower opacity are haze or blur at edges and are ignored; in 0..1.
    pub min_opacity: f64,
    /// Gaussians whose largest standard deviation exceeds this part of the object's size are ignored.
    pub max_relative_scale: f64,
    /// Base resolution, voxels per size of the object: 40 gives one to two thousand points.
    pub voxels_per_size: f64,
    /// Number of starts about the up axis. 16 are 22.5 degrees apart, a gap that refinement bridges.
    pub yaw_starts: usize,
    /// Random samples of matched features per pair of objects.
    pub trials: usize,
    /// Poses whose cost is within this factor of the best are compared by colour and pictures.
    pub near_tie: f64,
    /// A pose is ambiguous if the next best is worse by a smaller part than this.
    pub min_margin: f64,
    /// Least part of an object's surface that must agree with the reference.
    pub min_inliers: f64,
    /// Objects of a name that are tried as references of a group, one after the other, before those that are left count as unlike
    /// one another; 1 or more. Of objects without a name all are tried.
    pub most_references: usize,
    /// Seed of all random draws.
    pub seed: u64,
}

impl Default for RegisterOptions {
    fn default() -> Self {
        Self {
            allow_scale: false,
            min_opacity: 0.3,
            max_relative_scale: 0.05,
            voxels_per_size: 40.0,
            yaw_starts: 16,
            trials: 20_000,
            near_tie: 1.25,
            min_margin: 0.03,
            min_inliers: 0.5,
            most_references: 12,
            seed: 0,
        }
    }
}

impl RegisterOptions {
    /// Checks that all options are in range.
    pub(super) fn validate(&self) -> Result<(), RegisterError> {
        let part = |v: f64| (0.0..1.0).contains(&v);
        let above_0 = |v: f64| v > 0.0 && v.is_finite();
        let checks = [
            ("min_opacity", self.min_opacity, part(self.min_opacity), "from 0 to below 1"),
            ("max_relative_scale", self.max_relative_scale, above_0(self.max_relative_scale), "above 0"),
            // More voxels are finer than any Gaussian, and their keys would overflow.
            ("voxels_per_size", self.voxels_per_size, (4.0..=1000.0).contains(&self.voxels_per_size), "from 4 to 1000"),
            ("yaw_starts", self.yaw_starts as f64, (1..=360).contains(&self.yaw_starts), "from 1 to 360"),
            ("most_references", self.most_references as f64, self.most_references > 0, "1 or more"),
            ("near_tie", self.near_tie, self.near_tie >= 1.0 && self.near_tie.is_finite(), "1 or more"),
            ("min_margin", self.min_margin, part(self.min_margin), "from 0 to below 1"),
            ("min_inliers", self.min_inliers, part(self.min_inliers), "from 0 to below 1"),
        ];
        match checks.into_iter().find(|check| !check.2) {
            Some((option, value, _, want)) => Err(RegisterError::Option { option, value, want }),
            None => Ok(()),
        }
    }
}
