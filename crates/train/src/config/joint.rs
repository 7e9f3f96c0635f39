//! Settings of the joint phase; the reasons for their defaults are in `configs/default.toml`.

use instgs_vk::scene::gaussians::MAX_SH_DEGREE;
use serde::{Deserialize, Deserializer, Serialize};

use super::schedule::{GaussianRates, PoseRates, Rates, late_decay, log_linear};
use super::{DensifyConfig, Method, Strategy, TrainConfig};

/// The properties in which instances may differ from their template.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OffsetConfig {
    /// Offsets of the centres.
    pub position: bool,
    /// Offsets of SH coefficient 0, the base colour.
    pub sh_dc: bool,
    /// Offsets of the opacity logits.
    pub opacity: bool,
    /// SH degree up to which the other coefficients have offsets; 0 = they have none. Reports of older runs have `sh_rest`, which
    /// is true for all degrees.
    #[serde(alias = "sh_rest", deserialize_with = "degree_or_all")]
    pub sh_degree: u32,
    /// These learn in every so many steps, from the first on. Reports of older runs do not have it: they learned in every one.
    #[serde(default = "every_step")]
    pub sh_every: u64,
    /// Offsets of log scales and quaternions.
    pub covariance: bool,
}

fn every_step() -> u64 {
    1
}

/// An SH degree; `true` is the highest one, `false` is 0.
fn degree_or_all<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Either {
        Degree(u32),
        All(bool),
    }
    Ok(match Either::deserialize(deserializer)? {
        Either::Degree(degree) => degree,
        Either::All(all) => {
            if all {
                MAX_SH_DEGREE
            } else {
                0
            }
        }
    })
}

/// Settings of the joint phase, the second training run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointConfig {
    /// Number of optimisation steps.
    pub steps: u64,
    /// Whether the poses of instances are optimised.
    pub refine_poses: bool,
    /// Whether the scales of the poses are optimised too.
    pub refine_scales: bool,
    /// Poses and colour matrices are optimised in steps whose index is a multiple of this, at least 1.
    #[serde(default = "every_step")]
    pub instances_every: u64,
    /// Factor that all learning rates but those of the centres have reached at the end.
    pub final_factor: f64,
    /// Fraction of the steps after which the rates begin to decay, in 0..1.
    pub decay_start: f64,
    /// Number of steps within which the same rates fall by the same factor besides, from the first step on; 0 = they do not.
    pub decay_steps: u64,
    /// Opacity below which Gaussians are removed at the end; 0 = none are removed.
    pub prune_opacity: f64,
    /// Fraction of the steps before which templates and background are densified; 0 = their numbers stay.
    pub grow_fraction: f64,
    /// Upper bound of the number of expanded Gaussians in growth, times `max_gaussians`.
    pub max_expanded: f64,
    /// Largest part of a template's instances in which a Gaussian grows as their own instead of in all; 0 = always in all.
    pub own_share: f64,
    /// Learning rate of the colour matrices of instances; 0 = they have none.
    pub color_matrix_rate: f64,
}

/// Learning rates of the joint phase for one kind of Gaussians, parameter units per step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointRates {
    /// Centres at the first step, times the scene extent.
    pub means: f64,
    /// Centres at the last step, times the scene extent.
    pub means_final: f64,
    /// SH coefficient 0, the base colour.
    pub sh_dc: f64,
    /// The other SH coefficients.
    pub sh_rest: f64,
    /// Rate of the opacity logits.
    pub opacity: f64,
    /// Logarithms of the scales.
    pub log_scales: f64,
    /// Rate of the quaternions.
    pub quats: f64,
}

/// Learning rates of poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseRateConfig {
    /// Translation, times the scene extent.
    pub translation: f64,
    /// Rotation vector, radians.
    pub rotation: f64,
    /// Logarithm of the scale factor.
    pub log_scale: f64,
}

impl JointRates {
    /// The rates of step index `step` of `steps`; `factor` scales all rates except those of the centres.
    fn at(&self, step: u64, steps: u64, extent: f64, factor: f64) -> GaussianRates {
        GaussianRates {
            means: log_linear(self.means, self.means_final, step, steps) * extent,
            sh_dc: self.sh_dc * factor,
            sh_rest: self.sh_rest * factor,
            opacity: self.opacity * factor,
            log_scales: self.log_scales * factor,
            quats: self.quats * factor,
        }
    }
}

impl OffsetConfig {
    /// The rates of the offsets that instances have; the rates of all others are 0.
    fn rates(&self, rates: &GaussianRates) -> GaussianRates {
        let of = |has: bool, rate: f64| if has { rate } else { 0.0 };
        GaussianRates {
            means: of(self.position, rates.means),
            sh_dc: of(self.sh_dc, rates.sh_dc),
            opacity: of(self.opacity, rates.opacity),
            sh_rest: of(self.sh_degree > 0, rates.sh_rest),
            log_scales: of(self.covariance, rates.log_scales),
            quats: of(self.covariance, rates.quats),
        }
    }
}

impl TrainConfig {
    /// The configuration of the phase that the method itself adds: for `instgs` the joint phase, else `self`.
    pub(crate) fn own_phase(&self) -> Self {
        match self.method {
            Method::Gaussians => self.clone(),
            Method::Instanced => self.joint_phase(),
        }
    }

    /// The configuration of the first phase, which trains a plain cloud.
    pub fn cloud_phase(&self) -> Self {
        Self { method: Method::Gaussians, ..self.clone() }
    }

    /// A plain cloud without a later phase: its rates end as those of the joint phase do, but for `decay_steps`, which a phase as
    /// short as those that are compared so hardly notices.
    pub fn cloud_alone(&self) -> Self {
        let mut config = self.cloud_phase();
        (config.rates.final_factor, config.rates.decay_start) = (self.joint.final_factor, self.joint.decay_start);
        config.rates.decay_steps = 0;
        config
    }

    /// The configuration of the joint phase: its steps, all SH coefficients from the start, and densification for a part of
    /// the steps, whether the plain cloud's strategy is `densify` or `mcmc`; with `none` nothing grows.
    pub fn joint_phase(&self) -> Self {
        let JointConfig { steps, grow_fraction, max_expanded, .. } = self.joint;
        let grows = grow_fraction > 0.0 && self.strategy != Strategy::None;
        Self {
            method: Method::Instanced,
            steps,
            strategy: if grows { Strategy::Densify } else { Strategy::None },
            densify: DensifyConfig {
                // A short phase has no time to wait.
                start: self.densify.start.min(steps / 10),
                stop: steps,
                stop_fraction: grow_fraction,
                opacity_reset_every: 0,
                ..self.densify.clone()
            },
            max_gaussians: (f64::from(self.max_gaussians) * max_expanded) as u32,
            sh_every: 0,
            ..self.clone()
        }
    }

    /// Learning rates of step index `step` of the joint phase; `extent` is the scene's, scene units.
    pub(super) fn joint_rates_at(&self, step: u64, extent: f64) -> Rates {
        let JointConfig { final_factor, decay_start, decay_steps, .. } = self.joint;
        let long = if decay_steps > 0 { late_decay(final_factor, 0.0, step, decay_steps) } else { 1.0 };
        let factor = long * late_decay(final_factor, decay_start, step, self.steps);
        let at = |rates: &JointRates| rates.at(step, self.steps, extent, factor);
        let poses = &self.pose_rates;
        let refined = |refine: bool, rate: f64| if refine { rate * factor } else { 0.0 };
        let refine_poses = self.joint.refine_poses;
        Rates {
            template: at(&self.template_rates),
            background: at(&self.background_rates),
            offsets: self.offsets.rates(&at(&self.offset_rates)),
            color_matrices: self.joint.color_matrix_rate * factor,
            poses: PoseRates {
                translation: refined(refine_poses, poses.translation * extent),
                rotation: refined(refine_poses, poses.rotation),
                log_scale: refined(refine_poses && self.joint.refine_scales, poses.log_scale),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::config::{ConfigBuilder, ConfigError, Method, Strategy, TrainConfig};

    fn joint(sets: &[&str]) -> Result<TrainConfig, ConfigError> {
        let config = sets.iter().try_fold(ConfigBuilder::new(), |builder, set| builder.set(set))?.finish()?;
        Ok(config.joint_phase())
    }

    #[test]
    fn what_is_switched_off_is_held() -> Result<(), ConfigError> {
        let rates = joint(&[])?.rates_at(0, 2.0);
        assert_eq!((rates.template.means, rates.offsets.means, rates.background.sh_dc), (3.2e-4, 3.2e-4, 2.5e-3));
        assert_eq!((rates.offsets.sh_rest, rates.offsets.quats, rates.poses.log_scale), (0.0, 1e-3, 0.0));
        assert!(rates.poses.rotation > 0.0 && rates.poses.translation > 0.0);
        let rates = joint(&["offsets.position=false", "offsets.covariance=false", "joint.refine_poses=false"])?;
        let rates = rates.rates_at(0, 2.0);
        assert_eq!((rates.offsets.means, rates.offsets.log_scales, rates.offsets.quats), (0.0, 0.0, 0.0));
        assert!(rates.poses.are_held() && rates.offsets.opacity > 0.0);
        Ok(())
    }

    #[test]
    fn phases_have_their_own_steps_and_rates() -> Result<(), ConfigError> {
        let config = joint(&[
            "joint.steps=40",
            "steps=1000",
            "joint.final_factor=0.25",
            "joint.decay_start=0",
            "joint.decay_steps=0",
        ])?;
        assert_eq!((config.steps, config.method, config.strategy), (40, Method::Instanced, Strategy::Densify));
        assert_eq!(joint(&["joint.grow_fraction=0"])?.strategy, Strategy::None);
        assert_eq!(config.sh_degree_at(0), 3);
        let half = config.rates_at(20, 1.0);
        assert!((half.template.opacity / 0.0125 - 1.0).abs() < 1e-12);
        assert!((half.offsets.means / (1.6e-4f64 * 1.6e-5).sqrt() - 1.0).abs() < 1e-12);
        let long =
            joint(&["joint.steps=40", "joint.final_factor=0.25", "joint.decay_start=0.5", "joint.decay_steps=80"])?;
        // A quarter of the way of the one, half of the other's.
        assert!((long.rates_at(20, 1.0).template.opacity / (0.025 * 0.25f64.powf(0.25)) - 1.0).abs() < 1e-12);
        assert!((long.rates_at(30, 1.0).offsets.sh_dc / (2.5e-3 * 0.25f64.powf(0.375 + 0.5)) - 1.0).abs() < 1e-12);
        assert_eq!(long.rates_at(20, 1.0).offsets.means, half.offsets.means);
        let alone = config.cloud_alone();
        assert_eq!((alone.method, alone.rates.final_factor, alone.rates.decay_steps), (Method::Gaussians, 0.25, 0));
        assert!((alone.rates_at(20, 1.0).background.opacity / 0.0125 - 1.0).abs() < 1e-12);
        let first = config.cloud_phase();
        assert_eq!((first.method, first.rates_at(0, 1.0).offsets.means), (Method::Gaussians, 0.0));
        Ok(())
    }
}
