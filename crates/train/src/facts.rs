//! Facts that a training run leaves behind, as plain data: times, counts, sizes, quality. `report.json` is made of them.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::events::null_is_nan;
use instgs_eval::Metrics;
use instgs_vk::scene::{InstancedScene, RepeatedBytes};

/// Everything that is known of a training that is done: `trained.json`. The names are those of `report.json`, so that the report
/// of a version without that file can be read as well. Numbers that are not finite are `null` in the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrainFacts {
    /// `"3dgs"` or `"instgs"`.
    pub method: String,
    /// Finished steps.
    pub steps: u64,
    /// Steps a second of the optimisation alone, in the last part of the run.
    #[serde(deserialize_with = "null_is_nan")]
    pub steps_per_second: f64,
    /// Wall time of the parts, in order; of a run that was interrupted, of its last part.
    pub stages: Vec<StageTime>,
    /// Milliseconds a step by pass: timestamps on the device.
    pub passes_ms: BTreeMap<String, f64>,
    /// Means over the test views; `None` without test views.
    pub eval: Option<Quality>,
    /// Numbers of Gaussians.
    pub gaussians: Counts,
    /// Sizes.
    pub bytes: Bytes,
    /// Device name.
    pub device: String,
    /// Seed of the run.
    pub seed: u64,
    /// What sharing saves; `None` for a scene without instances.
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
}

/// How long a stage of a run took.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// For instance `load`, `train`, `eval`.
    pub name: String,
    /// Wall time.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

impl StageTime {
    /// The stage that began then and ends now.
    pub fn since(name: &str, start: Instant) -> Self {
        Self { name: name.into(), seconds: start.elapsed().as_secs_f64() }
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

impl From<Metrics> for Quality {
    fn from(metrics: Metrics) -> Self {
        Self { psnr: metrics.psnr, ssim: metrics.ssim, lpips: metrics.lpips }
    }
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
    /// Those of a scene.
    pub fn of(scene: &InstancedScene) -> Self {
        Self {
            template: scene.templates.len() as u64,
            offsets: scene.offsets.len() as u64,
            background: scene.background.len() as u64,
            expanded: scene.expanded_len(),
        }
    }

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
