//! The configuration of a training run: validated, resolved, plain values.
//!
//! Built-in defaults (`configs/default.toml`) < `--config` (file or preset) < `--set key=value` < flags such as
//! `--steps`: [`ConfigBuilder`] puts the layers together, [`keys`] lists the values that each key accepts, and this
//! file explains the keys. [`Layers`] does the same for any type that is a [`Configuration`]: the stages before and
//! after training have keys of their own. The methods of [`TrainConfig`] in the module `schedule` derive the values of
//! a given step, such as its learning [`Rates`].

pub mod empty_is_none;
mod error;
mod explain;
mod joint;
pub mod keys;
mod load;
mod schedule;

use std::path::PathBuf;

use instgs_vk::math::halves::Halves;
use instgs_vk::scene::{NearPlane, PixelFilter};
use serde::{Deserialize, Serialize};
use toml::Table;

use keys::Key;

pub use error::ConfigError;
pub use explain::{KeyText, explain};
pub use joint::{JointConfig, JointRates, OffsetConfig, PoseRateConfig};
pub use load::{Configuration, Layers, differences, to_toml};
pub use schedule::{GaussianRates, PoseRates, Rates};

/// Name and text of each preset of the trainer; the first holds the defaults.
pub const PRESETS: [(&str, &str); 3] = [
    ("default", include_str!("../../../../configs/default.toml")),
    ("quick", include_str!("../../../../configs/quick.toml")),
    ("mcmc", include_str!("../../../../configs/mcmc.toml")),
];

/// The layers of a configuration that has the trainer's keys only.
pub type ConfigBuilder = Layers<TrainConfig>;

/// Everything that decides the outcome of a training run, apart from the data and the device. Comments give units;
/// ranges are in [`keys::KEYS`], reasons in `configs/default.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Optimisation steps in all.
    pub steps: u64,
    /// Seed of every random choice.
    pub seed: u64,
    /// Width of the training pictures, pixels; 0 = that of the files.
    pub width: u32,
    /// Whether views without a photo are left out however many they are; up to half of them always are.
    pub skip_missing: bool,
    /// Folder of masks of the pixels that count, named like the photos: black pixels are neither trained on nor compared.
    #[serde(with = "empty_is_none")]
    pub pixel_masks: Option<PathBuf>,
    /// Whether a plain cloud or an instanced scene is trained.
    pub method: Method,
    /// Where the first Gaussians come from.
    pub init: Init,
    /// File of a scene whose Gaussians training starts from, instead of `init`.
    #[serde(with = "empty_is_none")]
    pub init_scene: Option<PathBuf>,
    /// Number of Gaussians of [`Init::Random`].
    pub init_count: u32,
    /// Opacity of the first Gaussians, in 0..1 without the ends. Not used with `init_scene`.
    pub init_opacity: f64,
    /// Their standard deviation, times the RMS distance to the three nearest neighbours. Not used with `init_scene`.
    pub init_scale: f64,
    /// SH degree at the end, 0..=3.
    pub sh_degree: u32,
    /// Steps between increments of the SH degree; 0 = the full degree from the start.
    pub sh_every: u64,
    /// Weight of 1 - SSIM in the loss, 0..=1; L1 has the rest.
    pub lambda_dssim: f64,
    /// Background colour of the training pictures.
    pub background: Background,
    /// Whether opacities are lowered to make up for the dilation of small splats.
    pub antialias: bool,
    /// Variance added to every projected splat, px^2.
    pub dilation: f64,
    /// View depth below which Gaussians are not drawn, scene units.
    pub near: f64,
    /// Upper bound of the number of Gaussians in densification; in the joint phase, of expanded ones, times
    /// `joint.max_expanded`.
    pub max_gaussians: u32,
    /// How the number of Gaussians changes.
    pub strategy: Strategy,
    /// Steps between evaluations of the test views; 0 = at the end only.
    pub eval_every: u64,
    /// Steps between checkpoints; 0 = at the end and on interrupt only.
    pub checkpoint_every: u64,
    /// Device memory that training may use, MiB; 0 = all that the device has.
    pub device_memory_mb: u32,
    /// Learning rates of a plain cloud.
    pub rates: RateConfig,
    /// Settings of [`Strategy::Densify`].
    pub densify: DensifyConfig,
    /// Settings of [`Strategy::Mcmc`].
    pub mcmc: McmcConfig,
    /// Exposures of the training photos.
    pub exposure: ExposureConfig,
    /// The properties in which instances have offsets. This and all keys below are for [`Method::Instanced`].
    pub offsets: OffsetConfig,
    /// Settings of the joint phase.
    pub joint: JointConfig,
    /// Learning rates of templates in the joint phase.
    pub template_rates: JointRates,
    /// Learning rates of the background in the joint phase.
    pub background_rates: JointRates,
    /// Learning rates of offsets in the joint phase.
    pub offset_rates: JointRates,
    /// Learning rates of poses in the joint phase.
    pub pose_rates: PoseRateConfig,
}

/// What kind of scene is trained.
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
    /// At the points of the data set's point cloud.
    Points,
    /// Uniformly distributed in a box that the cameras see.
    Random,
}

/// The background colour: what a pixel shows behind all splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Background {
    /// Black: linear RGB (0, 0, 0).
    Black,
    /// White: linear RGB (1, 1, 1).
    White,
    /// A random colour for each step.
    Random,
}

/// How the number of Gaussians changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Strategy {
    /// Clones, splits and prunes Gaussians and resets opacities.
    Densify,
    /// MCMC relocation, and noise, up to a fixed number of Gaussians.
    Mcmc,
    /// The number of Gaussians stays as it is.
    None,
}

/// What becomes of a Gaussian that grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Growth {
    /// A small one gets a copy, a large one is replaced by smaller ones that are drawn inside it.
    #[default]
    CloneOrSplit,
    /// It is replaced by two that divide its longest axis.
    Halves,
}

/// Learning rates of Adam, parameter units per step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateConfig {
    /// Centres at the first step, times the scene extent.
    pub means: f64,
    /// Centres after `means_steps`, times the scene extent.
    pub means_final: f64,
    /// Steps of the decay from `means` to `means_final`; 0 = those of the whole training.
    pub means_steps: u64,
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
    /// Factor that all learning rates but those of the centres have reached after `decay_steps`.
    pub final_factor: f64,
    /// Steps of that decay; 0 = those of the whole training. Reports of versions before this key, which did that, are read.
    #[serde(default)]
    pub decay_steps: u64,
    /// Fraction of these steps after which the rates begin to decay, in 0..1.
    pub decay_start: f64,
    /// Adam's decay rate of the mean gradient, in 0..1.
    pub beta1: f64,
    /// Adam's decay rate of the mean squared gradient, in 0..1.
    pub beta2: f64,
    /// Adam's term against division by zero.
    pub eps: f64,
}

/// Settings of densification: clone, split, prune, opacity reset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DensifyConfig {
    /// Densification runs only after this many finished steps.
    pub start: u64,
    /// Densification runs only before this many finished steps.
    pub stop: u64,
    /// Densification runs only before this fraction of all steps.
    pub stop_fraction: f64,
    /// Number of steps from one densification to the next: it runs when the number of finished steps is a multiple.
    pub every: u64,
    /// Mean length of the screen gradient above which a Gaussian grows, NDC units.
    pub gradient_threshold: f64,
    /// What becomes of it. Reports of versions before have no such key.
    #[serde(default)]
    pub growth: Growth,
    /// With [`Growth::CloneOrSplit`]: largest standard deviation above which it is split, as a fraction of the scene extent.
    pub split_fraction: f64,
    /// With [`Growth::CloneOrSplit`]: number of Gaussians that replace a split one.
    pub split_count: u32,
    /// Divisor of the scales of a Gaussian when it is split; with [`Growth::Halves`] of the longest alone.
    pub split_shrink: f64,
    /// With [`Growth::Halves`]: opacity of a half, times its own. Reports of versions before have no such key.
    #[serde(default = "unchanged")]
    pub half_opacity: f64,
    /// Opacity below which Gaussians are removed.
    pub opacity_min: f64,
    /// Steps between opacity resets; 0 = none. With [`Background::White`] there is one more, after `start` steps.
    pub opacity_reset_every: u64,
    /// Upper bound of all opacities after a reset.
    pub opacity_reset_to: f64,
    /// What is subtracted from every opacity after each densification; 0 = nothing.
    pub opacity_decay: f64,
    /// Part of `max_gaussians` that is made free for growth every `recycle_every` steps, if a cloud leaves less; 0 = nothing
    /// is removed for growth.
    pub recycle: f64,
    /// Steps from one such time to the next; the first densification behind each multiple counts.
    pub recycle_every: u64,
    /// Screen radius above which Gaussians are removed after the first reset, pixels; 0 = no limit.
    pub screen_size_max_px: f64,
    /// Largest standard deviation above which Gaussians are removed after the first reset, as a fraction of the scene
    /// extent; 0 = no limit.
    pub world_size_max: f64,
}

impl DensifyConfig {
    /// Number of Gaussians that replace a split one: halves are two, whatever `split_count` is.
    #[must_use]
    pub fn children(&self) -> u32 {
        if self.growth == Growth::Halves { 2 } else { self.split_count }
    }

    /// The halves that a Gaussian becomes with [`Growth::Halves`].
    #[must_use]
    pub fn halves(&self) -> Halves {
        Halves { shrink: self.split_shrink, opacity: self.half_opacity }
    }
}

/// Opacity of a half beside that of the whole in reports without the key: there were no halves, and nothing lost opacity.
fn unchanged() -> f64 {
    1.0
}

/// Settings of MCMC relocation, growth and noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct McmcConfig {
    /// Relocation runs only after this many finished steps.
    pub start: u64,
    /// Relocation runs only before this many finished steps.
    pub stop: u64,
    /// Relocation runs only before this fraction of all steps.
    pub stop_fraction: f64,
    /// Number of steps from one relocation to the next: it runs when the number of finished steps is a multiple.
    pub every: u64,
    /// Factor by which the number of Gaussians grows each time, 1 or more.
    pub growth: f64,
    /// Opacity below which a Gaussian counts as dead and is moved onto a live one.
    pub opacity_min: f64,
    /// Standard deviation of the noise on the centres, times their learning rate.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity_regularisation: f64,
    /// Weight of the mean scale in the loss.
    pub scale_regularisation: f64,
}

/// Settings of the exposures of the training photos: an affine map of the colours for each photo, learned with the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExposureConfig {
    /// Learning rate at the first step, colour units; 0 = photos have no exposures.
    pub rate: f64,
    /// Learning rate at the last step, colour units.
    pub rate_final: f64,
}

impl Method {
    /// The name of the method on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gaussians => "3dgs",
            Self::Instanced => "instgs",
        }
    }
}

impl Default for TrainConfig {
    /// The values of `configs/default.toml`.
    #[expect(clippy::expect_used, reason = "the built-in file is part of the program and tested")]
    fn default() -> Self {
        ConfigBuilder::new().finish().expect("configs/default.toml is complete and valid")
    }
}

impl TrainConfig {
    /// The filter of the training pictures, which the scene keeps.
    pub fn pixel_filter(&self) -> PixelFilter {
        PixelFilter { dilation_px2: self.dilation as f32, antialias: self.antialias }
    }

    /// The near plane of the training pictures, which the scene keeps.
    pub fn near_plane(&self) -> NearPlane {
        NearPlane(self.near as f32)
    }

    /// The configuration as TOML with every key, as in `RUN/config.toml`; loading it gives an equal one.
    ///
    /// # Errors
    /// The same errors as [`to_toml`].
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
        // Halves that are as long as the whole would lie in one place.
        require(
            densify.growth != Growth::Halves || densify.split_shrink > 1.0,
            "densify.split_shrink",
            "above 1 with",
            "densify.growth",
        )?;
        // What the loss would miss is judged by the gradients of opacities.
        let has_joint_phase = self.method == Method::Instanced;
        for (rate, is_used, name) in [
            (self.rates.opacity, true, "rates.opacity"),
            (self.template_rates.opacity, has_joint_phase, "template_rates.opacity"),
            (self.background_rates.opacity, has_joint_phase, "background_rates.opacity"),
        ] {
            let fits = densify.recycle == 0.0 || !is_used || rate > 0.0;
            require(fits, name, "above 0 with", "densify.recycle")?;
        }
        let room = f64::from(self.max_gaussians) * self.joint.max_expanded;
        require(
            self.joint.grow_fraction == 0.0 || room >= 1.0,
            "joint.max_expanded",
            "above 0 with",
            "joint.grow_fraction",
        )?;
        require(
            self.init != Init::Random || self.init_scene.is_some() || self.init_count <= self.max_gaussians,
            "init_count",
            "at most",
            "max_gaussians",
        )
    }
}
