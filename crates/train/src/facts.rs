//! Facts that a training run leaves behind, as plain data: times, counts, sizes, quality. `report.json` is made of them.

use serde::{Deserialize, Serialize};

use super::events::null_is_nan;

/// How long a stage of a run took.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// For instance `load`, `train`, `eval`.
    pub name: String,
    /// Wall time.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
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
