//! What can go wrong in the player, one line each.

use instgs_io::IoError;
use instgs_vk::gpu::GpuError;
use instgs_vk::render::RenderError;

/// Why the player stopped, or could not do what was asked for.
#[derive(Debug, thiserror::Error)]
pub enum PlayerError {
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Rendering.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A file.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The window system.
    #[error("window: {0}; without a display, --headless with --frames and --screenshot draws pictures")]
    Window(String),
    /// The player had to end, and wrote what was not saved.
    #[error("{reason}; what was not saved is in {files}")]
    Rescued {
        /// Why it had to end.
        reason: Box<PlayerError>,
        /// The files, or why there are none.
        files: String,
    },
}

impl PlayerError {
    /// The device or the window's surface is lost; what was on it can be made anew on another.
    pub fn is_lost(&self) -> bool {
        self.of_device().is_some_and(GpuError::is_lost)
    }

    /// The device has no room for what was asked of it; less may fit.
    pub fn is_out_of_memory(&self) -> bool {
        self.of_device().is_some_and(GpuError::is_out_of_memory)
    }

    fn of_device(&self) -> Option<&GpuError> {
        match self {
            Self::Gpu(gpu) | Self::Render(RenderError::Gpu(gpu)) => Some(gpu),
            _ => None,
        }
    }
}
