//! Balls around Gaussians, for culling and for the choice of levels of detail.

use glam::DVec3;

use crate::scene::Gaussians;

/// A ball around means, with the largest standard deviation of its Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Centre, units of the cloud; a value that f32 holds exactly.
    pub center: DVec3,
    /// Radius, the same units.
    pub radius: f64,
    /// Largest standard deviation, the same units; 0 without Gaussians.
    pub sigma_max: f64,
}

impl Bound {
    /// The ball of the `count` Gaussians of a cloud from index `first` on.
    ///
    /// # Panics
    /// If the cloud has fewer Gaussians.
    pub fn of(cloud: &Gaussians, first: usize, count: usize) -> Self {
        let means = &cloud.means[first..first + count];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for mean in means {
            low = low.min(dvec(*mean));
            high = high.max(dvec(*mean));
        }
        // The centre is stored as f32: measure the radius from the stored value.
        let center = if count == 0 { DVec3::ZERO } else { ((low + high) * 0.5).as_vec3().as_dvec3() };
        let radius = means.iter().map(|m| dvec(*m).distance(center)).fold(0.0, f64::max);
        let scales = &cloud.log_scales[first..first + count];
        let log_max = scales.iter().flatten().copied().fold(f32::NEG_INFINITY, f32::max);
        Self { center, radius, sigma_max: f64::from(log_max).exp() }
    }
}

/// Rounds up to f32 with a margin, so that a bound stays a bound.
pub fn round_up(value: f64) -> f32 {
    (value * (1.0 + 1e-6)) as f32
}

fn dvec(v: [f32; 3]) -> DVec3 {
    glam::Vec3::from(v).as_dvec3()
}
