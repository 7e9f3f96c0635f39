//! Errors of rendering, one line each, with a remedy.

use crate::gpu::GpuError;
use crate::scene::CameraError;

/// The reason why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The Vulkan layer failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The camera cannot be rendered.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The scene's indices are inconsistent.
    #[error(transparent)]
    Scene(#[from] crate::scene::instanced_scene::SceneError),
    /// An option is out of range.
    #[error("{option}: {reason}")]
    Option {
        /// Name of the option at fault.
        option: &'static str,
        /// Description of the problem and of the allowed values.
        reason: String,
    },
    /// The scene does not fit a precision below f32.
    #[error("{0}; --device-precision f32 draws it as it is")]
    Pack(#[from] super::packed_scene::PackError),
    /// All frames in flight are taken: wait for one first.
    #[error("{pending} pictures are on their way already; poll or wait for the oldest first")]
    Busy {
        /// Number of frames in flight.
        pending: usize,
    },
    /// The device counted more elements than memory can hold.
    #[error(
        "{what}: {needed} are needed, and this device holds at most {limit}; use fewer Gaussians, a view of fewer, or a \
         device with larger buffers"
    )]
    TooMany {
        /// The elements that are too many.
        what: &'static str,
        /// Number that the frame needs (saturating).
        needed: u64,
        /// Number that the device can hold.
        limit: u64,
    },
}
