//! A group's template before it becomes part of a scene.

use super::common_pose::TemplateFromWorld;
use super::offsets::clamped_logit;
use instgs_vk::math::covariance::logit;
use instgs_vk::math::nearest::PointSet;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::Gaussians;

/// Number of neighbours for spacings, as for the size of new Gaussians.
const SPACING_NEIGHBOURS: usize = 3;
/// Opacity of Gaussians that are reset, as in the paper.
const NEW_OPACITY: f64 = 0.1;
/// Smallest standard deviation of Gaussians that are reset, template units, for points that coincide: the square root
/// of the smallest variance in vanilla training.
const MIN_NEW_DEVIATION: f64 = 3.2e-4;
/// An instance lacks a template Gaussian whose match is farther than this many times its spacing or the median spacing
/// ...
const MAX_MATCH_SPACINGS: f64 = 3.0;
/// ... and farther than this part of the object's radius, the effect of a pose two degrees off.
const MAX_MATCH_RADII: f64 = 0.05;

/// The template's Gaussians, with lengths for comparing instances.
pub(super) struct TemplateCloud {
    /// Gaussians in the template's frame.
    pub gaussians: Gaussians,
    /// Root mean square distance of each Gaussian to its three nearest, template units.
    pub spacings: Vec<f64>,
    /// Median of `spacings`.
    pub median_spacing: f64,
    /// Median distance from the centre (median per axis), template units.
    pub radius: f64,
}

impl TemplateCloud {
    /// Takes pairs of an instance's inverse pose and the index of a Gaussian in the world's cloud.
    pub(super) fn new(cloud: &Gaussians, drawn: &[(&TemplateFromWorld, u32)]) -> Self {
        let mut gaussians = Gaussians::with_capacity(cloud.sh_degree, drawn.len());
        drawn.iter().for_each(|(frame, i)| frame.push(cloud, *i as usize, &mut gaussians));
        Self::from_gaussians(gaussians)
    }

    /// Takes Gaussians in the template's frame; opacity logits are clamped to the range that training can change.
    pub(super) fn from_gaussians(mut gaussians: Gaussians) -> Self {
        gaussians.opacity_logits.iter_mut().for_each(|logit| *logit = clamped_logit(*logit));
        let set = PointSet::new(&gaussians.means);
        let spacing = |&mean: &[f32; 3]| set.mean_squared_distance_to_others(mean, SPACING_NEIGHBOURS).sqrt();
        let spacings: Vec<f64> = gaussians.means.iter().map(spacing).collect();
        Self { median_spacing: median(spacings.clone()), radius: radius(&gaussians.means), gaussians, spacings }
    }

    /// Largest distance of a match from template Gaussian `i`, template units.
    pub(super) fn reach(&self, i: usize) -> f64 {
        (MAX_MATCH_RADII * self.radius).max(MAX_MATCH_SPACINGS * self.spacings[i].max(self.median_spacing))
    }

    /// Resets all parameters but positions and base colours.
    pub(super) fn renew(&mut self) {
        let per_gaussian = self.gaussians.sh_coefficients();
        self.gaussians.quats.fill([1.0, 0.0, 0.0, 0.0]);
        self.gaussians.opacity_logits.fill(logit(NEW_OPACITY) as f32);
        self.gaussians
            .sh
            .iter_mut()
            .enumerate()
            .filter(|(c, _)| c % per_gaussian != 0)
            .for_each(|(_, c)| *c = [0.0; 3]);
        for (log_scales, spacing) in self.gaussians.log_scales.iter_mut().zip(&self.spacings) {
            *log_scales = [spacing.max(MIN_NEW_DEVIATION).ln() as f32; 3];
        }
    }
}

/// The median, the upper one of two; 0 without values.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Median distance from the centre (median per axis).
pub(super) fn radius(means: &[[f32; 3]]) -> f64 {
    let middle: [f32; 3] =
        std::array::from_fn(|axis| median(means.iter().map(|m| f64::from(m[axis])).collect()) as f32);
    median(means.iter().map(|&m| widened(m).distance(widened(middle))).collect())
}
