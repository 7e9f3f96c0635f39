//! The configuration of a training run: validated, resolved, plain values.
//!
//! Built-in defaults (`configs/default.toml`) < `--config` (file or preset) < `--set key=value` < flags such as
//! `--steps`: [`ConfigBuilder`] puts the layers together, [`keys`] says what a key may be, this file explains each.
//! [`Layers`] does the same for any type that is a [`Configuration`]: what comes before and after training has keys of
//! its own. What the values mean at a step is in the methods of [`TrainConfig`] ([`Rates`] and the schedule).

pub mod empty_is_none;
mod error;
mod joint;
pub mod keys;
mod load;
mod schedule;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use toml::Table;

use keys::Key;

pub use error::ConfigError;
pub use joint::{JointConfig, JointRates, OffsetConfig, PoseRateConfig};
pub use load::{Configuration, Layers, differences, to_toml};
pub use schedule::{OffsetRates, PoseRates, Rates, SourceRates};

/// Name and text of each preset of the trainer; the first holds the defaults.
pub const PRESETS: [(&str, &str); 4] = [
    ("default", include_str!("../../../../configs/default.toml")),
    ("quick", include_str!("../../../../configs/quick.toml")),
    ("paper", include_str!("../../../../configs/paper.toml")),
    ("mcmc", include_str!("../../../../configs/mcmc.toml")),
];

/// Puts together a configuration of the trainer alone.
pub type ConfigBuilder = Layers<TrainConfig>;

/// Everything that decides the outcome of a training run, apart from the data and the device. Comments give units;
/// ranges are in [`keys::KEYS`], reasons in `configs/default.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Optimisation steps in all.
    pub steps: u64,
    /// Fixes every random choice.
    pub seed: u64,
    /// Width of the training pictures, pixels; 0 = as they are.
    pub width: u32,
    /// What is trained.
    pub method: Method,
    /// Where the first Gaussians come from.
    pub init: Init,
    /// A scene whose Gaussians come first instead.
    #[serde(with = "empty_is_none")]
    pub init_scene: Option<PathBuf>,
    /// Gaussians of [`Init::Random`].
    pub init_count: u32,
    /// Opacity of the first Gaussians, in 0..1 without the ends. Not of those of a scene.
    pub init_opacity: f64,
    /// Their standard deviation, times the distance to their three nearest neighbours. Not of those of a scene.
    pub init_scale: f64,
    /// SH degree at the end, 0..=3.
    pub sh_degree: u32,
    /// Steps between increments of the SH degree; 0 = the full degree from the start.
    pub sh_every: u64,
    /// Weight of 1 - SSIM in the loss, 0..=1; L1 has the rest.
    pub lambda_dssim: f64,
    /// What is behind the Gaussians.
    pub background: Background,
    /// Opacity compensation for the dilation.
    pub antialias: bool,
    /// Gaussians nearer than this view depth are not drawn, scene units.
    pub near: f64,
    /// Densification never goes beyond so many Gaussians.
    pub max_gaussians: u32,
    /// How the number of Gaussians changes.
    pub strategy: Strategy,
    /// Steps between evaluations of the test views; 0 = at the end only.
    pub eval_every: u64,
    /// Steps between checkpoints; 0 = at the end and on interrupt only.
    pub checkpoint_every: u64,
    /// Device memory that training may use, MiB; 0 = what the device has.
    pub device_memory_mb: u32,
    /// Learning rates.
    pub rates: RateConfig,
    /// For [`Strategy::Densify`].
    pub densify: DensifyConfig,
    /// For [`Strategy::Mcmc`].
    pub mcmc: McmcConfig,
    /// What instances have of their own. This and all that follows is for [`Method::Instanced`].
    pub offsets: OffsetConfig,
    /// The joint phase.
    pub joint: JointConfig,
    /// Its learning rates, for templates.
    pub template_rates: JointRates,
    /// For the background.
    pub background_rates: JointRates,
    /// For offsets.
    pub offset_rates: JointRates,
    /// For poses.
    pub pose_rates: PoseRateConfig,
}

/// What is trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// A plain cloud of Gaussians.
    #[serde(rename = "3dgs")]
    Gaussians,
    /// Templates, instances with offsets, and a background.
    #[serde(rename = "instgs")]
    Instanced,
}

/// Where the first Gaussians come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Init {
    /// The data set's point cloud.
    Points,
    /// Uniform in the cameras' box.
    Random,
}

/// What is behind the Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// (0, 0, 0).
    Black,
    /// (1, 1, 1).
    White,
    /// A colour drawn for each step.
    Random,
}

/// How the number of Gaussians changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Strategy {
    /// Clone, split, prune, reset opacities.
    Densify,
    /// Relocation and noise up to a fixed number.
    Mcmc,
    /// It stays as it is.
    None,
}

/// Learning rates of Adam, parameter units per step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateConfig {
    /// Centres at the first step, times the scene extent.
    pub means: f64,
    /// Centres after `means_steps`, times the scene extent.
    pub means_final: f64,
    /// Steps of the decay from one to the other; 0 = the training's.
    pub means_steps: u64,
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
    /// Factor that all rates but the centres' have reached at the end.
    pub final_factor: f64,
    /// Part of the steps after which they begin to decay, in 0..1.
    pub decay_start: f64,
    /// Adam's decay of the mean gradient, in 0..1.
    pub beta1: f64,
    /// Adam's decay of the mean squared gradient, in 0..1.
    pub beta2: f64,
    /// Adam's term against division by zero.
    pub eps: f64,
}

/// Clone, split, prune.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensifyConfig {
    /// Densification happens after this many steps are done,
    pub start: u64,
    /// before this many are,
    pub stop: u64,
    /// and before this part of the training's steps is,
    pub stop_fraction: f64,
    /// whenever the number done is a multiple of this.
    pub every: u64,
    /// Mean length of the screen gradient above which a Gaussian is cloned or split, NDC units.
    pub gradient_threshold: f64,
    /// Largest scale above which it is split, part of the scene extent.
    pub split_fraction: f64,
    /// How many replace a split one.
    pub split_count: u32,
    /// What a split one's scales are divided by.
    pub split_shrink: f64,
    /// Opacity below which Gaussians are removed.
    pub opacity_min: f64,
    /// Steps between opacity resets; 0 = none. Before [`Background::White`] there is one more, after `start` steps.
    pub opacity_reset_every: u64,
    /// Opacity that a reset leaves at most.
    pub opacity_reset_to: f64,
    /// Screen radius above which Gaussians are removed after the first reset, pixels; 0 = no limit.
    pub screen_size_max_px: f64,
    /// Largest scale above which Gaussians are removed after the first reset, part of the scene extent; 0 = no limit.
    pub world_size_max: f64,
}

/// Relocation and noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct McmcConfig {
    /// Relocation happens after this many steps are done,
    pub start: u64,
    /// before this many are,
    pub stop: u64,
    /// and before this part of the training's steps is,
    pub stop_fraction: f64,
    /// whenever the number done is a multiple of this.
    pub every: u64,
    /// Factor by which the number of Gaussians grows each time, 1 or more.
    pub growth: f64,
    /// Opacity below which Gaussians are moved onto others.
    pub opacity_min: f64,
    /// Noise on the centres, times their learning rate.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity_regularisation: f64,
    /// Weight of the mean scale in the loss.
    pub scale_regularisation: f64,
}

impl Method {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gaussians => "3dgs",
            Self::Instanced => "instgs",
        }
    }
}

impl Default for TrainConfig {
    /// `configs/default.toml`.
    #[expect(clippy::expect_used, reason = "the built-in file is part of the program and tested")]
    fn default() -> Self {
        ConfigBuilder::new().finish().expect("configs/default.toml is complete and valid")
    }
}

impl TrainConfig {
    /// The configuration as TOML with every key, as in `RUN/config.toml`; loading it gives an equal one.
    ///
    /// # Errors
    /// As for [`to_toml`].
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        to_toml(self)
    }
}

impl Configuration for TrainConfig {
    fn keys() -> Vec<Key> {
        keys::KEYS.into()
    }

    fn defaults() -> &'static [(&'static str, &'static str)] {
        &PRESETS[..1]
    }

    fn presets() -> &'static [(&'static str, &'static str)] {
        &PRESETS
    }

    fn from_table(table: Table) -> Result<Self, toml::de::Error> {
        table.try_into()
    }

    fn to_table(&self) -> Result<Table, toml::ser::Error> {
        Table::try_from(self)
    }

    fn check(&self, shown: &dyn Fn(&str) -> String) -> Result<(), ConfigError> {
        let require = |fits: bool, first: &str, relation: &'static str, second: &str| match fits {
            true => Ok(()),
            false => Err(ConfigError::Conflict { first: shown(first), relation, second: shown(second) }),
        };
        let (densify, mcmc) = (&self.densify, &self.mcmc);
        require(densify.start <= densify.stop, "densify.start", "at most", "densify.stop")?;
        require(mcmc.start <= mcmc.stop, "mcmc.start", "at most", "mcmc.stop")?;
        // Otherwise the pruning after a reset would remove every Gaussian.
        require(
            densify.opacity_reset_every == 0 || densify.opacity_reset_to > densify.opacity_min,
            "densify.opacity_reset_to",
            "above",
            "densify.opacity_min",
        )?;
        require(
            self.init != Init::Random || self.init_count <= self.max_gaussians,
            "init_count",
            "at most",
            "max_gaussians",
        )
    }
}
