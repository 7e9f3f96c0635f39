//! What `--method instgs` adds to the configuration; reasons in `configs/instgs.toml`.

use serde::{Deserialize, Serialize};

use super::schedule::{OffsetRates, PoseRates, Rates, SourceRates, late_decay, log_linear};
use super::{Method, Strategy, TrainConfig};
use crate::detect::{DetectOptions, PromptOptions, Provider, RuntimeOptions};
use crate::template::{HOPELESS_MATCH, Keep, OffsetInit, OffsetKinds, Sampling, TemplateOptions, TemplateSource};

/// How things are found by name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectConfig {
    /// A box counts if its best token scores more.
    pub box_threshold: f64,
    /// A box is of a phrase if one of its tokens scores more.
    pub text_threshold: f64,
    /// Of two boxes or masks that overlap by more than this, the one with the lower score is dropped.
    pub overlap: f64,
    /// What the models run on.
    pub provider: Provider,
}

impl DetectConfig {
    /// For the detector. The runtime library is the one that the environment names, or the system's.
    pub fn options(&self) -> PromptOptions {
        let &Self { box_threshold, text_threshold, overlap, provider } = self;
        let detect = DetectOptions { box_threshold, text_threshold, overlap };
        PromptOptions { detect, runtime: RuntimeOptions { provider, ..RuntimeOptions::default() } }
    }
}

/// Which Gaussian belongs to which object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SegmentConfig {
    /// Weight of what a Gaussian adds to other pixels than the object's.
    pub alpha: f64,
    /// Gaussians that no view shows go with their neighbours.
    pub fill_unseen: bool,
    /// Small groups of an object's Gaussians that are apart from it go back to the background.
    pub drop_strays: bool,
}

/// How templates are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemplateConfig {
    /// Whose Gaussians.
    pub source: TemplateSource,
    /// How the mean number is drawn from merged ones.
    pub sampling: Sampling,
    /// What a Gaussian keeps.
    pub keep: Keep,
    /// Gaussians of a template, times the mean number of an instance's.
    pub count_factor: f64,
    /// How often a merged template is made the mean of its matches.
    pub settle_rounds: u32,
}

/// What instances have of their own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OffsetConfig {
    /// Centres.
    pub position: bool,
    /// SH coefficient 0.
    pub sh_dc: bool,
    /// Opacity logits.
    pub opacity: bool,
    /// The other SH coefficients.
    pub sh_rest: bool,
    /// Log scales and quaternions.
    pub covariance: bool,
    /// What they start from.
    pub init: OffsetInit,
}

/// The second phase.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointConfig {
    /// Optimisation steps.
    pub steps: u64,
    /// Poses learn.
    pub refine_poses: bool,
    /// Their scales, too.
    pub refine_scales: bool,
    /// Factor that rates other than the centres' have reached at the end.
    pub final_factor: f64,
    /// Part of the steps after which they begin to decay, in 0..1.
    pub decay_start: f64,
    /// Gaussians whose blending weight (sum over pixels) per training view that shows them is less than this part of the
    /// mean of their kind (an object's group, or the background), and whose centre is in the frame of one, are removed
    /// before the phase; 0 = none.
    pub prune_weight: f64,
    /// Opacity below which Gaussians are removed at the end; 0 = none.
    pub prune_opacity: f64,
}

/// Learning rates of the joint phase for one kind of Gaussians, parameter units per step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointRates {
    /// Centres at the first step, times the scene extent.
    pub means: f64,
    /// Centres at the last step, times the scene extent.
    pub means_final: f64,
    /// SH coefficient 0.
    pub sh_dc: f64,
    /// The other SH coefficients.
    pub sh_rest: f64,
    /// Opacity logits.
    pub opacity: f64,
    /// Logarithms of the scales.
    pub log_scales: f64,
    /// Quaternions.
    pub quats: f64,
}

/// Learning rates of poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseRateConfig {
    /// Times the scene extent.
    pub translation: f64,
    /// Radians.
    pub rotation: f64,
    /// Logarithm of the scale.
    pub log_scale: f64,
}

impl JointRates {
    /// At a step; `factor` is that of all rates but the centres'.
    fn at(&self, step: u64, steps: u64, extent: f64, factor: f64) -> SourceRates {
        SourceRates {
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
    /// The rates of what instances have of their own; what they do not have is held.
    fn rates(&self, rates: &SourceRates) -> OffsetRates {
        let of = |has: bool, rate: f64| if has { rate } else { 0.0 };
        OffsetRates {
            means: of(self.position, rates.means),
            sh_dc: of(self.sh_dc, rates.sh_dc),
            opacity: of(self.opacity, rates.opacity),
            sh_rest: of(self.sh_rest, rates.sh_rest),
            log_scales: of(self.covariance, rates.log_scales),
            quats: of(self.covariance, rates.quats),
        }
    }
}

impl TrainConfig {
    /// What the steps of this method's own phase go by: of `instgs`, the joint phase.
    pub(crate) fn own_phase(&self) -> Self {
        match self.method {
            Method::Gaussians => self.clone(),
            Method::Instanced => self.joint_phase(),
        }
    }

    /// The configuration of the first phase: a plain cloud.
    pub fn cloud_phase(&self) -> Self {
        Self { method: Method::Gaussians, ..self.clone() }
    }

    /// A plain cloud that nothing comes after: its rates end as those of the joint phase do.
    pub fn cloud_alone(&self) -> Self {
        let mut config = self.cloud_phase();
        (config.rates.final_factor, config.rates.decay_start) = (self.joint.final_factor, self.joint.decay_start);
        config
    }

    /// The configuration of the joint phase: its steps, all SH coefficients from the start, no densification.
    pub fn joint_phase(&self) -> Self {
        Self {
            method: Method::Instanced,
            steps: self.joint.steps,
            strategy: Strategy::None,
            sh_every: 0,
            ..self.clone()
        }
    }

    /// How templates are made.
    pub fn template_options(&self) -> TemplateOptions {
        let (template, offsets) = (&self.template, &self.offsets);
        TemplateOptions {
            source: template.source,
            sampling: template.sampling,
            keep: template.keep,
            offsets: offsets.init,
            kinds: OffsetKinds {
                position: offsets.position,
                sh_dc: offsets.sh_dc,
                opacity: offsets.opacity,
                sh_rest: offsets.sh_rest,
                covariance: offsets.covariance,
            },
            count_factor: template.count_factor,
            settle_rounds: template.settle_rounds,
            // What the user has as a group is one.
            worst_match: self.groups.is_empty().then_some(HOPELESS_MATCH),
            seed: self.seed,
        }
    }

    /// Learning rates of step index `step` of the joint phase; `extent` is the scene's, scene units.
    pub(super) fn joint_rates_at(&self, step: u64, extent: f64) -> Rates {
        let factor = late_decay(self.joint.final_factor, self.joint.decay_start, step, self.steps);
        let at = |rates: &JointRates| rates.at(step, self.steps, extent, factor);
        let poses = &self.pose_rates;
        let refined = |refine: bool, rate: f64| if refine { rate * factor } else { 0.0 };
        let refine_poses = self.joint.refine_poses;
        Rates {
            template: at(&self.template_rates),
            background: at(&self.background_rates),
            offsets: self.offsets.rates(&at(&self.offset_rates)),
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
        assert_eq!((rates.template.means, rates.offsets.means, rates.background.sh_dc), (1.6e-4, 1.6e-4, 2.5e-3));
        assert_eq!((rates.offsets.sh_rest, rates.offsets.quats, rates.poses.log_scale), (0.0, 0.0, 0.0));
        assert!(rates.poses.rotation > 0.0 && rates.poses.translation > 0.0);
        let rates = joint(&["offsets.position=false", "offsets.covariance=true", "joint.refine_poses=false"])?;
        let rates = rates.rates_at(0, 2.0);
        assert_eq!((rates.offsets.means, rates.offsets.log_scales), (0.0, 5e-3));
        assert!(rates.poses.are_held() && rates.offsets.opacity > 0.0);
        Ok(())
    }

    #[test]
    fn phases_have_their_own_steps_and_rates() -> Result<(), ConfigError> {
        let config = joint(&["joint.steps=40", "steps=1000", "joint.final_factor=0.25", "joint.decay_start=0"])?;
        assert_eq!((config.steps, config.method, config.strategy), (40, Method::Instanced, Strategy::None));
        assert_eq!(config.sh_degree_at(0), 3);
        let half = config.rates_at(20, 1.0);
        assert!((half.template.opacity / 0.0125 - 1.0).abs() < 1e-12);
        assert!((half.offsets.means / (8e-5f64 * 1.6e-6).sqrt() - 1.0).abs() < 1e-12);
        let alone = config.cloud_alone();
        assert_eq!((alone.method, alone.rates.final_factor), (Method::Gaussians, 0.25));
        assert!((alone.rates_at(20, 1.0).background.opacity / 0.0125 - 1.0).abs() < 1e-12);
        let first = config.cloud_phase();
        assert_eq!((first.method, first.rates_at(0, 1.0).offsets.means), (Method::Gaussians, 0.0));
        Ok(())
    }
}
