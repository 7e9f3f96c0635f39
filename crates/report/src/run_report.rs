//! `report.json`: all results of a finished run.

use std::fmt;

use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use super::JointMatch;
use instgs_io::json::{as_map, null_is_nan};
use instgs_objects::pipeline::config::RunConfig;
use instgs_objects::register::InstanceRegistration;
use instgs_objects::template::GroupReport;
use instgs_train::facts::{Bytes, Counts, DatasetFacts, MemoryUse, Metrics, StageTime, ViewMetrics};
use instgs_vk::scene::RepeatedBytes;

/// The report of a training run. Numbers that are not finite are `null` in the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RunReport {
    /// `"3dgs"` or `"instgs"`.
    pub method: String,
    /// Number of finished steps.
    pub steps: u64,
    /// Wall time of all stages, seconds. Of a resumed run, training counts from the beginning; loading, saving and
    /// evaluating count since it was last resumed.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
    /// Steps per second of the optimisation alone.
    #[serde(deserialize_with = "null_is_nan")]
    pub steps_per_second: f64,
    /// Wall time of each stage, in order.
    pub stages: Vec<StageTime>,
    /// Milliseconds per step for each pass, by name, from timestamps on the device.
    #[serde(serialize_with = "as_map", deserialize_with = "from_map")]
    pub passes_ms: Vec<(String, f64)>,
    /// Means over the test views; `None` if there are none.
    pub eval: Option<Metrics>,
    /// Numbers of Gaussians.
    pub gaussians: Counts,
    /// Sizes of file, scene and device memory.
    pub bytes: Bytes,
    /// Warnings about masks, objects and groups, one line each; empty for 3dgs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Registration of each instance; empty for 3dgs.
    pub registration: Vec<InstanceRegistration>,
    /// The groups after merging; empty for 3dgs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<GroupReport>,
    /// Name of the device in use.
    pub device: String,
    /// Seed of all random choices.
    pub seed: u64,
    /// Version of instgs-vk.
    pub version: String,
    /// For instgs: the report of the plain cloud that it started from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vanilla: Option<Box<RunReport>>,
    /// For instgs: when the joint phase reached that cloud's loss on the training views; `None` if it did not, or if
    /// the cloud was not trained by this run.
    pub joint_match: Option<JointMatch>,
    /// For instgs: the bytes that instancing saves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeated: Option<RepeatedBytes>,
    /// Fraction of a step's wall time in which the host does not wait for the device, 0..=1.
    #[serde(deserialize_with = "null_is_nan")]
    pub host_fraction: f64,
    /// What device memory is used for.
    pub memory_explained: Vec<MemoryUse>,
    /// Quality of each test view.
    pub views: Vec<ViewMetrics>,
    /// The data set that was trained on.
    pub dataset: DatasetFacts,
    /// The resolved configuration.
    pub config: RunConfig,
}

/// Reads the pairs of a JSON object, in its order.
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
