//! The configuration of a whole run: the trainer's keys ([`TrainConfig`]) and those of the pipeline
//! ([`PipelineConfig`]), in one file. The values that a key accepts are in [`keys`] and [`instgs_train::config::keys`];
//! its purpose is explained in `configs/default.toml` and `configs/instgs.toml`.

pub mod keys;

use std::path::PathBuf;

use serde::de::Error as _;
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::{Table, Value};

use crate::template::{
    Doubles, HOPELESS_MATCH, Keep, OffsetInit, OffsetKinds, Sampling, TemplateOptions, TemplateSource, Unmatched,
};
use instgs_detect::{DetectOptions, PromptOptions, Provider, RuntimeOptions};
use instgs_train::config::keys::Key;
use instgs_train::config::{
    ConfigError, Configuration, Growth, Layers, Method, PRESETS as TRAINER_PRESETS, TrainConfig, differences,
    empty_is_none, to_toml,
};
use instgs_vk::math::halves::Halves;

/// Name and text of each preset that `--config` knows; the first two hold the defaults.
pub const PRESETS: [(&str, &str); 9] = [
    TRAINER_PRESETS[0],
    (INSTGS, include_str!("../../../../../configs/instgs.toml")),
    TRAINER_PRESETS[1],
    ("paper", include_str!("../../../../../configs/paper.toml")),
    TRAINER_PRESETS[2],
    ("instgs_quick", include_str!("../../../../../configs/instgs_quick.toml")),
    ("instgs_early", include_str!("../../../../../configs/instgs_early.toml")),
    ("instgs_renders", include_str!("../../../../../configs/instgs_renders.toml")),
    ("instgs_sparse", include_str!("../../../../../configs/instgs_sparse.toml")),
];

/// The preset whose values are the defaults of `method = "instgs"`.
const INSTGS: &str = "instgs";

/// The layers of the configuration of a whole run.
pub type ConfigBuilder = Layers<RunConfig>;

/// Everything that decides the outcome of a run, apart from data and device. Files mix the keys of both parts.
#[derive(Clone, Debug, PartialEq)]
pub struct RunConfig {
    /// Configuration of the training, for both phases.
    pub train: TrainConfig,
    /// Configuration of the stages between the two phases.
    pub pipeline: PipelineConfig,
}

/// Configuration of the stages from photos and a plain cloud to templates and instances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PipelineConfig {
    /// `groups.json`; without it the objects of the masks are registered.
    #[serde(with = "empty_is_none")]
    pub groups: Option<PathBuf>,
    /// Folder of masks; without it, and without `boxes` and `prompt`, the data set's. At most one of the three.
    #[serde(with = "empty_is_none")]
    pub masks: Option<PathBuf>,
    /// `boxes.json`: masks are made from these boxes and the plain cloud.
    #[serde(with = "empty_is_none")]
    pub boxes: Option<PathBuf>,
    /// What to detect in the photos, phrases that end in full stops: models make the masks.
    #[serde(with = "empty_is_none")]
    pub prompt: Option<String>,
    /// Folder of the models that `prompt` needs.
    #[serde(with = "empty_is_none")]
    pub models: Option<PathBuf>,
    /// Settings of detection from `prompt`.
    pub detect: DetectConfig,
    /// Settings of labelling: the object that each Gaussian belongs to.
    pub segment: SegmentConfig,
    /// Settings of the merge into templates.
    pub template: TemplateConfig,
    /// Initial values of the offsets of instances.
    pub offsets: OffsetStart,
    /// Pruning before the joint phase.
    pub joint: JointStart,
}

/// Settings of detection from words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectConfig {
    /// A box counts if the score of its best token is above this, 0..=1.
    pub box_threshold: f64,
    /// A box belongs to a phrase if the score of one of its tokens is above this, 0..=1.
    pub text_threshold: f64,
    /// If two boxes or masks overlap by more than this fraction, the one with the lower score is dropped.
    pub overlap: f64,
    /// The device that the models run on.
    pub provider: Provider,
}

impl DetectConfig {
    /// Options for the detector. The runtime library is the one that the environment names, or the system's.
    pub fn options(&self) -> PromptOptions {
        let &Self { box_threshold, text_threshold, overlap, provider } = self;
        let detect = DetectOptions { box_threshold, text_threshold, overlap };
        PromptOptions { detect, runtime: RuntimeOptions { provider, ..RuntimeOptions::default() } }
    }
}

/// Settings of labelling: the object that each Gaussian belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SegmentConfig {
    /// Weight of a Gaussian's contribution to pixels outside of the object.
    pub alpha: f64,
    /// Whether Gaussians that no view shows get the label of their neighbours.
    pub fill_unseen: bool,
    /// Whether small groups of an object's Gaussians that are apart from it go back to the background.
    pub drop_strays: bool,
}

/// Settings of the merge into templates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemplateConfig {
    /// Whether all objects of a group contribute Gaussians, or only one.
    pub source: TemplateSource,
    /// How the Gaussians of a template are drawn from those of all objects.
    pub sampling: Sampling,
    /// The properties that a drawn Gaussian keeps.
    pub keep: Keep,
    /// Number of a template's Gaussians, as a multiple of the mean number of its objects.
    pub count_factor: f64,
    /// Number of rounds in which template Gaussians are moved to the mean of their matches.
    pub settle_rounds: u32,
    /// What becomes of an object's Gaussians without a match.
    pub unmatched: Unmatched,
}

/// Initial values of the offsets of instances. The properties that have offsets are in the trainer's
/// [`OffsetConfig`](instgs_train::config::OffsetConfig).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OffsetStart {
    /// Whether offsets start at the difference to the template, or at zero.
    pub init: OffsetInit,
}

/// Pruning before the joint phase. The phase itself is configured by the trainer's
/// [`JointConfig`](instgs_train::config::JointConfig).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointStart {
    /// Gaussians are removed before the phase if their blending weight (sum over pixels), per training view that shows
    /// them, is below this fraction of the mean of their kind (an object's group, or the background), and if their
    /// centre is in the frame of a view; 0 = none are removed.
    pub prune_weight: f64,
}

impl Default for RunConfig {
    /// The values of `configs/default.toml` and `configs/instgs.toml`.
    #[expect(clippy::expect_used, reason = "the built-in files are part of the program and tested")]
    fn default() -> Self {
        ConfigBuilder::new().finish().expect("the built-in files are complete and valid")
    }
}

impl RunConfig {
    /// The configuration as TOML with every key, as in `RUN/config.toml`; loading it gives an equal one.
    ///
    /// # Errors
    /// The same errors as [`to_toml`].
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        to_toml(self)
    }

    /// Lists the keys whose values differ, each as (key, own value, value in `other`), the values as TOML.
    ///
    /// # Errors
    /// The same errors as [`to_toml`].
    pub fn differences(&self, other: &Self) -> Result<Vec<(String, String, String)>, ConfigError> {
        differences(self, other)
    }

    /// The configuration of the first phase, which trains a plain cloud.
    pub fn cloud_phase(&self) -> Self {
        Self { train: self.train.cloud_phase(), pipeline: self.pipeline.clone() }
    }

    /// A plain cloud without a later phase: its rates end as those of the joint phase do.
    pub fn cloud_alone(&self) -> Self {
        Self { train: self.train.cloud_alone(), pipeline: self.pipeline.clone() }
    }

    /// Options for the merge into templates.
    pub fn template_options(&self) -> TemplateOptions {
        let (template, offsets, densify) = (&self.pipeline.template, &self.train.offsets, &self.train.densify);
        // Without halves in growth its keys say nothing of them.
        let halves = match densify.growth {
            Growth::Halves => densify.halves(),
            Growth::CloneOrSplit => Halves::default(),
        };
        TemplateOptions {
            source: template.source,
            sampling: template.sampling,
            keep: template.keep,
            offsets: self.pipeline.offsets.init,
            doubles: Doubles::Halves(halves),
            kinds: OffsetKinds {
                position: offsets.position,
                sh_dc: offsets.sh_dc,
                opacity: offsets.opacity,
                sh_degree: offsets.sh_degree,
                covariance: offsets.covariance,
            },
            count_factor: template.count_factor,
            settle_rounds: template.settle_rounds,
            unmatched: template.unmatched,
            // Groups given by the user are never dissolved.
            worst_match: self.pipeline.groups.is_none().then_some(HOPELESS_MATCH),
            seed: self.train.seed,
        }
    }
}

impl Configuration for RunConfig {
    fn keys() -> Vec<Key> {
        [TrainConfig::keys(), keys::KEYS.into()].concat()
    }

    fn defaults() -> &'static [(&'static str, &'static str)] {
        &PRESETS[..2]
    }

    fn replaces_defaults(name: &str, method: Option<&str>) -> bool {
        name == INSTGS && method == Some(Method::Instanced.name())
    }

    fn presets() -> &'static [(&'static str, &'static str)] {
        &PRESETS
    }

    /// Takes the pipeline's keys out of the table; all others must be the trainer's.
    fn from_table(mut table: Table) -> Result<Self, toml::de::Error> {
        let mut own = Table::new();
        for key in keys::KEYS {
            let (section, name) = key.name.split_once('.').unwrap_or(("", key.name));
            let (from, to) = match section {
                "" => (Some(&mut table), &mut own),
                _ => {
                    let to = own.entry(section).or_insert_with(|| Value::Table(Table::new()));
                    let Value::Table(to) = to else { continue };
                    (table.get_mut(section).and_then(Value::as_table_mut), to)
                }
            };
            if let Some(value) = from.and_then(|from| from.remove(name)) {
                to.insert(name.into(), value);
            }
        }
        table.retain(|_, value| value.as_table().is_none_or(|section| !section.is_empty()));
        Ok(Self { train: TrainConfig::from_table(table)?, pipeline: own.try_into()? })
    }

    fn to_table(&self) -> Result<Table, toml::ser::Error> {
        let mut table = self.train.to_table()?;
        for (key, value) in Table::try_from(&self.pipeline)? {
            match (table.get_mut(&key), value) {
                (Some(Value::Table(section)), Value::Table(own)) => section.extend(own),
                (_, value) => drop(table.insert(key, value)),
            }
        }
        Ok(table)
    }

    fn check(&self, shown: &dyn Fn(&str) -> String) -> Result<(), ConfigError> {
        self.train.check(shown)?;
        if self.train.method != Method::Instanced {
            return Ok(());
        }
        let compares = self.pipeline.offsets.init == OffsetInit::Difference && self.template_options().kinds.any();
        if self.pipeline.template.unmatched == Unmatched::Own && !compares {
            let first = shown("template.unmatched");
            let relation = "\"drop\", since nothing is matched, with";
            return Err(ConfigError::Conflict { first, relation, second: shown("offsets.init") });
        }
        Ok(())
    }
}

impl Serialize for RunConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.to_table().map_err(S::Error::custom)?.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for RunConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::from_table(Table::deserialize(deserializer)?).map_err(|e| D::Error::custom(e.message()))
    }
}

#[cfg(test)]
mod tests;
