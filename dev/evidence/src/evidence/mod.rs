//! What is claimed, and what it rests on: the comparison of DESIGN section 7 over a list of scenes, as tables and plots.
//! Running it is the command line's (`instgs-vk tables`); here are the list, what a scene's measurement holds, and what
//! is written about all of them.

pub mod label_truth;
pub mod plots;
pub mod scene_list;
mod sheet;
pub mod tables;

use serde::{Deserialize, Serialize};

use super::comparison::{Row, SeedResult};

pub use scene_list::{ListError, Part, SceneJob, SceneList};
pub use sheet::{Cell, Sheet};

/// A scene that has been measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneResult {
    /// Its name in the list.
    pub name: String,
    /// Made by `synth`; else a real or foreign data set.
    pub synthetic: bool,
    /// Why it was measured.
    pub part: Part,
    /// One comparison for each seed of training.
    pub seeds: Vec<SeedResult>,
    /// How objects were found, of the first seed.
    pub segmentation: Segmentation,
    /// Instances of the trained scene, of the first seed.
    pub instances: u64,
    /// How much of what its objects differ by is shown, 0..=1.
    pub differences: f64,
    /// The same plain cloud with other settings, of the first seed.
    pub ablations: Vec<Ablation>,
    /// Device name.
    pub device: String,
}

/// How objects were found in a plain cloud.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Segmentation {
    /// Gaussians of the cloud.
    pub gaussians: u64,
    /// Objects found.
    pub objects: u64,
    /// Wall time of consensus, labels, registration and merging, in that order.
    pub seconds: [f64; 4],
    /// Memory of what Gaussians add to masks, bytes.
    pub bytes: u64,
    /// Mean over the true objects of the part of their Gaussians that has their label; `None` without depth pictures.
    pub mean_accuracy: Option<f64>,
}

/// A run with another setting.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ablation {
    /// Table that it belongs to.
    pub table: String,
    /// What it is.
    pub name: String,
    /// How good it is.
    pub row: Row,
}
