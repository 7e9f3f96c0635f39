//! `report.json`: everything that is known of a run once it is done.

use std::fmt;

use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::JointMatch;
use instgs_objects::pipeline::config::RunConfig;
use instgs_objects::register::InstanceRegistration;
use instgs_objects::template::GroupReport;
use instgs_train::events::null_is_nan;
use instgs_train::facts::{Bytes, Counts, DatasetFacts, MemoryUse, Quality, StageTime, ViewMetrics};
use instgs_vk::scene::RepeatedBytes;

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
    pub stages: Vec<StageTime>,
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
    pub config: RunConfig,
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
