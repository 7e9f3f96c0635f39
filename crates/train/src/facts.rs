//! Facts that a training run leaves behind, as plain data: times, counts, sizes, quality. `report.json` is made of them.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Deserialize, Serialize};

pub use instgs_eval::{Bytes, Counts, Metrics, ViewMetrics};
use instgs_io::json::null_is_nan;
use instgs_vk::scene::RepeatedBytes;

/// All results of a finished training run, as written to `trained.json`. The names are those of `report.json`, so that
/// the report of an older version, which has no `trained.json`, can be read as well. Numbers that are not finite are
/// `null` in the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrainFacts {
    /// `"3dgs"` or `"instgs"`.
    pub method: String,
    /// Number of finished steps.
    pub steps: u64,
    /// Steps per second of the optimisation alone, near the end of the run.
    #[serde(deserialize_with = "null_is_nan")]
    pub steps_per_second: f64,
    /// Wall time of the stages, in order; of a resumed run, since it was last resumed.
    pub stages: Vec<StageTime>,
    /// Milliseconds per step for each pass, from timestamps on the device.
    pub passes_ms: BTreeMap<String, f64>,
    /// Means over the test views; `None` without test views.
    pub eval: Option<Metrics>,
    /// Numbers of Gaussians.
    pub gaussians: Counts,
    /// Sizes of file, scene and device memory.
    pub bytes: Bytes,
    /// Name of the device in use.
    pub device: String,
    /// Seed of all random choices.
    pub seed: u64,
    /// The bytes that instancing saves; `None` for a scene without instances.
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
}

/// How long a stage of a run took.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// For instance `load`, `train`, `eval`.
    pub name: String,
    /// Wall time in seconds.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

impl StageTime {
    /// The stage `name`, which began at `start` and ends now.
    pub fn since(name: &str, start: Instant) -> Self {
        Self { name: name.into(), seconds: start.elapsed().as_secs_f64() }
    }
}

/// A use of device memory: `bytes` is `count` times `bytes_each`, plus the rounding of buffer sizes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MemoryUse {
    /// Purpose, for instance `parameters`.
    pub name: String,
    /// Number of bytes in all.
    pub bytes: u64,
    /// Unit that the use grows with, for instance `Gaussian`, `intersection`, `pixel`.
    pub per: String,
    /// Number of these units that there is room for.
    pub count: u64,
    /// Number of bytes for each unit.
    #[serde(deserialize_with = "null_is_nan")]
    pub bytes_each: f64,
}

/// The data set that was trained on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DatasetFacts {
    /// The folder as the user gave it.
    pub path: String,
    /// Number of training views.
    pub train_views: u64,
    /// Number of test views.
    pub test_views: u64,
    /// Largest width of the training pictures, pixels.
    pub width: u32,
    /// Largest height of the training pictures, pixels.
    pub height: u32,
    /// Number of points of the data set's point cloud.
    pub points: u64,
    /// Scene extent, scene units: the factor of `rates.means` and similar keys.
    pub extent: f64,
}
