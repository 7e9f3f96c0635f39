//! What a measurement says, in the shape of the JSON (DESIGN section 6).

use serde::Serialize;

use crate::io::json::as_map;
use crate::kernels::Variant;
use crate::math::statistics::Percentiles;

/// One scene, or two measured side by side.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scene that was asked for.
    #[serde(flatten)]
    pub scene: SceneReport,
    /// The scene it is compared with, frame by frame in turn.
    pub against: Option<SceneReport>,
    /// How the two compare.
    pub ratio: Option<Ratio>,
    /// Most memory the process has used so far, bytes (resident set), where the system tells.
    pub process_peak_bytes: Option<u64>,
}

/// One scene's figures.
#[derive(Clone, Debug, Serialize)]
pub struct SceneReport {
    /// The scene's file.
    pub scene: String,
    /// Device name.
    pub device: String,
    /// Driver name and version.
    pub driver: String,
    /// Kernel sizes.
    pub variant: Variant,
    /// Width and height of the first camera, pixels; `cameras` has each one's.
    pub resolution: [u32; 2],
    /// Timed frames.
    pub frames: u32,
    /// Wall time of a frame from recording to the end on the device, without download, milliseconds.
    pub ms: Percentiles,
    /// 1000 / median.
    pub fps: f64,
    /// Milliseconds a frame by pass, medians of frames of their own with timestamps.
    #[serde(serialize_with = "as_map")]
    pub passes_ms: Vec<(&'static str, f64)>,
    /// Wall time of those frames, median, milliseconds: what timestamps add shows beside `ms`.
    pub profiled_ms: f64,
    /// Numbers of Gaussians.
    pub gaussians: Counts,
    /// Sizes.
    pub bytes: Bytes,
    /// Most depth slabs that a frame took.
    pub slabs: u32,
    /// By camera.
    pub cameras: Vec<CameraReport>,
}

/// Numbers of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// In templates.
    pub template: u64,
    /// Offset records.
    pub offsets: u64,
    /// In the background.
    pub background: u64,
    /// After expanding all instances.
    pub expanded: u64,
    /// Touching at least one tile; mean over the cameras.
    pub visible: u64,
    /// (splat, tile) pairs; mean over the cameras.
    pub intersections: u64,
}

/// Sizes in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Bytes {
    /// The scene's file.
    pub file: u64,
    /// Scene tensors handed to the device, as f32.
    pub host: u64,
    /// Scene buffers on the device.
    pub device_scene: u64,
    /// Most device memory in use while this scene was uploaded and rendered, frame buffers and staging included.
    pub device_peak: u64,
}

/// One camera's figures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraReport {
    /// Camera name.
    pub name: String,
    /// Width and height, pixels.
    pub resolution: [u32; 2],
    /// Timed frames from it.
    pub frames: u32,
    /// Wall time, milliseconds.
    pub ms: Percentiles,
    /// Splats that touch at least one tile.
    pub visible: u64,
    /// (splat, tile) pairs.
    pub intersections: u64,
    /// Depth slabs.
    pub slabs: u32,
}

/// Above 1, the scene is better than the one it is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratio {
    /// Its frames per second by the other's.
    pub fps: f64,
    /// The other's file by its own; `null` if its own has no bytes.
    pub file: f64,
    /// The other's host tensors by its own.
    pub host: f64,
    /// The other's scene buffers by its own.
    pub device_scene: f64,
}

impl Ratio {
    /// Compares two scenes.
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
