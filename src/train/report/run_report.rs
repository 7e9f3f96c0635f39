//! `report.json`. The names of DESIGN section 5 come first; what follows them is this version's own.

use std::fmt;

use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::JointMatch;
use crate::register::InstanceRegistration;
use crate::scene::RepeatedBytes;
use crate::template::GroupReport;
use crate::train::config::TrainConfig;
use crate::train::events::null_is_nan;

/// A training run. Numbers that are not finite are `null` in the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RunReport {
    /// `"3dgs"` or `"instgs"`.
    pub method: String,
    /// Finished steps.
    pub steps: u64,
    /// Wall time of all stages. Of a run that was interrupted, training counts in all its parts, loading, saving and
    /// evaluating in the last.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
    /// Over the optimisation alone.
    #[serde(deserialize_with = "null_is_nan")]
    pub steps_per_second: f64,
    /// What the time went into, in order.
    pub stages: Vec<Stage>,
    /// Milliseconds a step by pass, in the order of a step: timestamps on the device.
    #[serde(serialize_with = "as_map", deserialize_with = "from_map")]
    pub passes_ms: Vec<(String, f64)>,
    /// Means over the test views; `None` if there are none.
    pub eval: Option<Quality>,
    /// Numbers of Gaussians.
    pub gaussians: Counts,
    /// Sizes.
    pub bytes: Bytes,
    /// What the user should know of masks, objects and groups, one line each; empty for 3dgs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Instances found; empty for 3dgs.
    pub registration: Vec<InstanceRegistration>,
    /// What became of the groups; empty for 3dgs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<GroupReport>,
    /// Device name.
    pub device: String,
    /// Seed of the run.
    pub seed: u64,
    /// Version of instgs-vk.
    pub version: String,
    /// For instgs: the scene it started from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vanilla: Option<Box<RunReport>>,
    /// For instgs: when the joint phase was as good on the training views as that scene; `None` if it was not, or if the
    /// scene was not trained here.
    pub joint_match: Option<JointMatch>,
    /// For instgs: what sharing saves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeated: Option<RepeatedBytes>,
    /// Part of a step's wall time in which the host does not wait for the device, 0..=1.
    #[serde(deserialize_with = "null_is_nan")]
    pub host_fraction: f64,
    /// What device memory is used for.
    pub memory_explained: Vec<MemoryUse>,
    /// Every test view.
    pub views: Vec<ViewMetrics>,
    /// What was trained on.
    pub dataset: DatasetFacts,
    /// The resolved configuration.
    pub config: TrainConfig,
}

/// A stage of the run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// For instance `load`, `train`, `eval`.
    pub name: String,
    /// Wall time.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

impl Stage {
    /// True for what stands between the plain cloud's training and the joint phase's: from masks to templates.
    pub fn is_preparation(&self) -> bool {
        ["consensus", "segment", "register", "refine poses", "merge"].contains(&self.name.as_str())
    }

    /// True for what a scene needs: training, its preparation, and making masks; not loading, evaluating and drawing.
    pub fn makes_scene(&self) -> bool {
        self.name.ends_with("train") || self.name == "masks" || self.is_preparation()
    }
}

/// How near a rendering is to its photograph.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Peak signal-to-noise ratio, dB; infinite if they are equal.
    #[serde(deserialize_with = "null_is_nan")]
    pub psnr: f64,
    /// Structural similarity, at most 1.
    #[serde(deserialize_with = "null_is_nan")]
    pub ssim: f64,
    /// Perceptual distance, 0 is best; `None` without weights to compute it with.
    pub lpips: Option<f64>,
}

/// Numbers of Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// In templates; 0 for 3dgs.
    pub template: u64,
    /// Offset records; 0 for 3dgs.
    pub offsets: u64,
    /// In the background; for 3dgs, all.
    pub background: u64,
    /// After expanding all instances; for 3dgs, all.
    pub expanded: u64,
}

impl Counts {
    /// Gaussians in the file: of templates and background.
    pub fn stored(&self) -> u64 {
        self.template + self.background
    }
}

/// Sizes, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Bytes {
    /// The result's file.
    pub file: u64,
    /// Scene tensors handed to the device, as f32.
    pub host: u64,
    /// Scene buffers on the device.
    pub device_scene: u64,
    /// Most device memory in use at a time.
    pub device_peak: u64,
}

/// A use of device memory: `bytes` is `count` times `bytes_each`, rounded up to what buffers are made in.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MemoryUse {
    /// What for, for instance `parameters`.
    pub name: String,
    /// In all.
    pub bytes: u64,
    /// What it grows with, for instance `Gaussian`, `intersection`, `pixel`.
    pub per: String,
    /// How many of those there is room for.
    pub count: u64,
    /// For each.
    #[serde(deserialize_with = "null_is_nan")]
    pub bytes_each: f64,
}

/// A test view.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewMetrics {
    /// View name.
    pub name: String,
    /// Its figures.
    #[serde(flatten)]
    pub quality: Quality,
}

/// What was trained on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DatasetFacts {
    /// Folder as given.
    pub path: String,
    /// Training views.
    pub train_views: u64,
    /// Test views.
    pub test_views: u64,
    /// Width of the (first) training picture, pixels.
    pub width: u32,
    /// Its height, pixels.
    pub height: u32,
    /// Points of the data set's cloud.
    pub points: u64,
    /// Scene extent, scene units: what `rates.means` and the like are multiplied by.
    pub extent: f64,
}

/// A JSON object in the order of the list.
fn as_map<S: Serializer>(pairs: &[(String, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().map(|(name, value)| (name, value)))
}

/// The list in the order of the JSON object.
fn from_map<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<(String, f64)>, D::Error> {
    struct Pairs;
    impl<'de> Visitor<'de> for Pairs {
        type Value = Vec<(String, f64)>;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("an object of numbers")
        }
        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
            std::iter::from_fn(|| map.next_entry().transpose()).collect()
        }
    }
    deserializer.deserialize_map(Pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_needs_its_masks_but_no_evaluation() {
        let makes_scene = |name: &&str| Stage { name: name.to_string(), seconds: 1.0 }.makes_scene();
        let all = ["3dgs: load", "3dgs: train", "masks", "consensus", "segment", "register", "merge", "eval"];
        let needed: Vec<&str> = all.into_iter().filter(makes_scene).collect();
        assert_eq!(needed, ["3dgs: train", "masks", "consensus", "segment", "register", "merge"]);
    }
}
