//! Errors of rendering.

use crate::gpu::GpuError;
use crate::scene::CameraError;

/// Why a frame could not be rendered.
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
        /// The option's name.
        option: &'static str,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// What is on its way has to be taken first.
    #[error("{pending} pictures are on their way already; poll or wait for the oldest first")]
    Busy {
        /// Pictures on their way.
        pending: usize,
    },
    /// The device counted more elements than memory can hold.
    #[error(
        "{what}: {needed} are needed, and this device holds at most {limit}; use fewer Gaussians, a view of fewer, or a \
         device with larger buffers"
    )]
    TooMany {
        /// What there are too many of.
        what: &'static str,
        /// How many the frame needs (a saturating count).
        needed: u64,
        /// How many fit.
        limit: u64,
    },
}
