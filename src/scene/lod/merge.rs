//! Replaces several Gaussians by one of the same mass, mean, covariance and mean colour.

use glam::{DMat3, DVec3};

use crate::math::covariance::{covariance, logit, quat_from_rotation, sigmoid};
use crate::math::eigen::symmetric_eigen;
use crate::math::sh::widened;
use crate::scene::Gaussians;

/// Range of the opacities of merged Gaussians: logits stay moderate, and the renderer clamps alpha at 0.99 anyway.
const OPACITY: (f64, f64) = (1e-4, 0.995);
/// Smallest variance relative to the largest: flat clouds stay invertible in f32.
const THINNEST: f64 = 1e-8;

/// The parameters of a merged Gaussian.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// Centre, units of the cloud; like every field as in [`Gaussians`].
    pub mean: [f32; 3],
    /// Rotation as a quaternion (w, x, y, z).
    pub quat: [f32; 4],
    /// Logarithms of standard deviations.
    pub log_scales: [f32; 3],
    /// Logit of the opacity.
    pub opacity_logit: f32,
    /// All SH coefficients, `[C][rgb]`.
    pub sh: Vec<[f32; 3]>,
}

impl Merged {
    /// Merges the `members` of a cloud, at least one; a single one stays as it is.
    ///
    /// Weights are mass: opacity times area. Mean, covariance and SH coefficients are those of the mixture. The opacity
    /// absorbs as much light as the members would if they lay at random over the merged one's area: each has an optical
    /// depth of `-ln(1 - opacity)` on its own area. `log_scales` replaces the shape that the opacity refers to.
    pub fn of(cloud: &Gaussians, members: &[u32], log_scales: Option<[f32; 3]>) -> Self {
        if let [one] = members {
            return Self::single(cloud, *one as usize);
        }
        let weights = weights(cloud, members);
        let weighted = |of: &dyn Fn(usize) -> DVec3| {
            members.iter().zip(&weights).map(|(&i, &w)| of(i as usize) * w).sum::<DVec3>()
        };
        let mean = weighted(&|i| widened(cloud.means[i]));
        let (quat, own_log_scales) = shape(mixture_covariance(cloud, members, &weights, mean));
        let area = mean_area(log_scales.unwrap_or(own_log_scales));
        let depth_area: f64 = members.iter().map(|&i| optical_depth(cloud, i) * area_of(cloud, i)).sum();
        let opacity = (-(-depth_area / area).exp_m1()).clamp(OPACITY.0, OPACITY.1);
        Self {
            mean: mean.as_vec3().to_array(),
            quat,
            log_scales: own_log_scales,
            opacity_logit: logit(opacity) as f32,
            sh: (0..cloud.sh_coefficients())
                .map(|c| weighted(&|i| widened(cloud.sh_of(i)[c])).as_vec3().to_array())
                .collect(),
        }
    }

    fn single(cloud: &Gaussians, i: usize) -> Self {
        Self {
            mean: cloud.means[i],
            quat: cloud.quats[i],
            log_scales: cloud.log_scales[i],
            opacity_logit: cloud.opacity_logits[i],
            sh: cloud.sh_of(i).to_vec(),
        }
    }

    /// Appends the merged Gaussian to a cloud of the same degree.
    pub(super) fn push_to(&self, cloud: &mut Gaussians) {
        cloud.means.push(self.mean);
        cloud.quats.push(self.quat);
        cloud.log_scales.push(self.log_scales);
        cloud.opacity_logits.push(self.opacity_logit);
        cloud.sh.extend_from_slice(&self.sh);
    }
}

/// Mass of each member as a fraction of the sum; equal fractions if the sum is zero.
fn weights(cloud: &Gaussians, members: &[u32]) -> Vec<f64> {
    let mass = |&i: &u32| sigmoid(f64::from(cloud.opacity_logits[i as usize])) * area_of(cloud, i);
    let masses: Vec<f64> = members.iter().map(mass).collect();
    let sum: f64 = masses.iter().sum();
    if !(sum.is_finite() && sum > 0.0) {
        return vec![1.0 / members.len() as f64; members.len()];
    }
    masses.into_iter().map(|m| m / sum).collect()
}

/// `-ln(1 - sigmoid(x))` without cancellation; finite for any opacity.
fn optical_depth(cloud: &Gaussians, i: u32) -> f64 {
    let x = f64::from(cloud.opacity_logits[i as usize]);
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

fn area_of(cloud: &Gaussians, i: u32) -> f64 {
    mean_area(cloud.log_scales[i as usize])
}

/// Projected area of an ellipsoid, roughly its mean over all directions, up to a factor: the root of the sum of squares
/// of the three areas along its axes.
fn mean_area(log_scales: [f32; 3]) -> f64 {
    let [x, y, z] = log_scales.map(|l| (2.0 * f64::from(l)).exp());
    (x * y + y * z + z * x).sqrt()
}

fn mixture_covariance(cloud: &Gaussians, members: &[u32], weights: &[f64], mean: DVec3) -> DMat3 {
    let of = |(&i, &w): (&u32, &f64)| {
        let i = i as usize;
        let d = widened(cloud.means[i]) - mean;
        let own = covariance(cloud.quats[i].map(f64::from), widened(cloud.log_scales[i]));
        (own + DMat3::from_cols(d * d.x, d * d.y, d * d.z)) * w
    };
    members.iter().zip(weights).map(of).fold(DMat3::ZERO, |sum, m| sum + m)
}

/// Quaternion and log standard deviations of a covariance.
fn shape(covariance: DMat3) -> ([f32; 4], [f32; 3]) {
    let pairs = symmetric_eigen(covariance.transpose().to_cols_array_2d());
    let mut axes = pairs.map(|(_, axis)| DVec3::from_array(axis));
    if DMat3::from_cols(axes[0], axes[1], axes[2]).determinant() < 0.0 {
        axes[2] = -axes[2];
    }
    let quat = quat_from_rotation(DMat3::from_cols(axes[0], axes[1], axes[2]));
    let least = (THINNEST * pairs[2].0).max(f64::MIN_POSITIVE);
    (quat.map(|q| q as f32), pairs.map(|(variance, _)| (0.5 * variance.max(least).ln()) as f32))
}
