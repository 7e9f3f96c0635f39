//! Report of a measurement; its fields are those of the JSON.

use serde::Serialize;

use crate::{Bytes, Counts};
use instgs_io::json::as_map;
use instgs_vk::kernels::Variant;
use instgs_vk::math::statistics::Percentiles;
use instgs_vk::scene::DevicePrecision;

/// Measurement of one scene, or of two in turn.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scene that was measured.
    #[serde(flatten)]
    pub scene: SceneReport,
    /// The scene it is compared with, if any; frames alternate.
    pub against: Option<SceneReport>,
    /// Ratios of the two scenes.
    pub ratio: Option<Ratio>,
    /// Peak memory of the process (resident set), bytes, where the system reports it.
    pub process_peak_bytes: Option<u64>,
}

/// Measurements of one scene.
#[derive(Clone, Debug, Serialize)]
pub struct SceneReport {
    /// Path of the scene file.
    pub scene: String,
    /// Name of the Vulkan device.
    pub device: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Sizes of the kernels.
    pub variant: Variant,
    /// How the device held the scene.
    pub device_precision: DevicePrecision,
    /// Width and height of the first camera, pixels; `cameras` has those of each.
    pub resolution: [u32; 2],
    /// Number of timed frames.
    pub frames: u32,
    /// Wall time of a frame from recording to the end on the device, without read-back, milliseconds.
    pub ms: Percentiles,
    /// Frames per second: 1000 / median of `ms`.
    pub fps: f64,
    /// Milliseconds per frame of each pass, medians of separate frames with timestamps.
    #[serde(serialize_with = "as_map")]
    pub passes_ms: Vec<(&'static str, f64)>,
    /// Median wall time of the frames with timestamps, milliseconds; the difference to `ms` is their cost.
    pub profiled_ms: f64,
    /// Numbers of Gaussians, splats and pairs.
    pub gaussians: DrawnCounts,
    /// Sizes of file and memory.
    pub bytes: Bytes,
    /// Largest number of depth slabs in a frame.
    pub slabs: u32,
    /// Measurements of each camera.
    pub cameras: Vec<CameraReport>,
}

/// Numbers of Gaussians in the scene, and of splats and pairs in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct DrawnCounts {
    /// Gaussians of the scene.
    #[serde(flatten)]
    pub scene: Counts,
    /// Splats that touch at least one tile, mean over the cameras.
    pub visible: u64,
    /// (splat, tile) pairs, mean over the cameras.
    pub intersections: u64,
}

/// Measurements of one camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraReport {
    /// Name of the camera in its file.
    pub name: String,
    /// Width and height, pixels.
    pub resolution: [u32; 2],
    /// Number of timed frames.
    pub frames: u32,
    /// Wall time of a frame, milliseconds.
    pub ms: Percentiles,
    /// Number of splats that touch at least one tile.
    pub visible: u64,
    /// Number of (splat, tile) pairs.
    pub intersections: u64,
    /// Number of depth slabs.
    pub slabs: u32,
}

/// Ratios of two scenes; above 1 the measured scene is better.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratio {
    /// Its frames per second over the other's.
    pub fps: f64,
    /// The other's file size over its own; `null` if its own is 0.
    pub file: f64,
    /// The other's tensor size over its own.
    pub host: f64,
    /// The other's scene buffers over its own.
    pub device_scene: f64,
}

impl Ratio {
    /// Compares a scene with another one.
    pub fn of(scene: &SceneReport, against: &SceneReport) -> Self {
        let bytes = |field: fn(&Bytes) -> u64| field(&against.bytes) as f64 / field(&scene.bytes) as f64;
        Self {
            fps: scene.fps / against.fps,
            file: bytes(|b| b.file),
            host: bytes(|b| b.host),
            device_scene: bytes(|b| b.device_scene),
        }
    }
}
