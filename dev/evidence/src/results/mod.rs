//! Evidence for the method: the comparison of [`crate::protocol`] over a list of scenes, as tables and plots. The
//! command `instgs-vk tables` runs it; this module has the list, the results of a scene, and the tables and plots.

pub mod label_truth;
pub mod plots;
pub mod scene_list;
mod sheet;
pub mod tables;

use serde::{Deserialize, Serialize};

use crate::origin::Origin;
use crate::protocol::{DrawLimits, Row, SeedResult};

pub use scene_list::{ListError, Part, SceneJob, SceneList};
pub use sheet::{Cell, Sheet};

/// Results of one scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneResult {
    /// Name of the scene in the list.
    pub name: String,
    /// Whether `synth` made it; otherwise it is a real or foreign data set.
    pub synthetic: bool,
    /// Purpose of the measurement.
    pub part: Part,
    /// One comparison for each seed of training.
    pub seeds: Vec<SeedResult>,
    /// How objects were found, for the first seed.
    pub segmentation: Segmentation,
    /// Number of instances in the trained scene, for the first seed.
    pub instances: u64,
    /// Part of the differences between objects that is shown, 0..=1.
    pub differences: f64,
    /// Runs from the same plain cloud with other settings, for the first seed.
    pub ablations: Vec<Ablation>,
    /// The most Gaussians that its scenes may draw.
    #[serde(default)]
    pub limits: DrawLimits,
    /// The program and the device that all of it comes from.
    #[serde(flatten)]
    pub origin: Origin,
}

/// Statistics of finding objects in a plain cloud.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Segmentation {
    /// Number of Gaussians in the cloud.
    pub gaussians: u64,
    /// Number of objects that were found.
    pub objects: u64,
    /// Wall time of consensus, labels, registration and merging, in this order, seconds.
    pub seconds: [f64; 4],
    /// Memory for contributions to masks, bytes.
    pub bytes: u64,
    /// Mean over the true objects of the part of their Gaussians with their label; `None` without depth images.
    pub mean_accuracy: Option<f64>,
}

/// A run with another setting.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ablation {
    /// Key of the table that it belongs to.
    pub table: String,
    /// Name of the setting.
    pub name: String,
    /// Measurement of the resulting scene.
    pub row: Row,
}
