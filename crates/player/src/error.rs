//! Errors of the player, each a message of one line.

use instgs_console::opened::FollowError;
use instgs_io::IoError;
use instgs_vk::gpu::GpuError;
use instgs_vk::render::RenderError;
use instgs_vk::scene::edit::EditError;

/// Why the player stopped or a command failed.
#[derive(Debug, thiserror::Error)]
pub enum PlayerError {
    /// The Vulkan device failed or refused memory.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A render pass failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The pages of a scene cannot be drawn.
    #[error(transparent)]
    Pages(#[from] FollowError),
    /// The window system failed.
    #[error("window: {0}; without a display, use --headless with --frames and --screenshot")]
    Window(String),
    /// A file that was being written when the window closed could not be.
    #[error("{0}")]
    Unwritten(String),
    /// A script asked for something that is not there.
    #[error("the script stops: {0}")]
    Script(String),
    /// The player had to end and wrote unsaved work to files.
    #[error("{reason}; unsaved work: {files}")]
    Rescued {
        /// The error that ended the player.
        reason: Box<PlayerError>,
        /// The files that were written, or why they could not be.
        files: String,
    },
}

impl PlayerError {
    /// True if the device or the window's surface is lost. Everything on it can be created again on another device.
    pub fn is_lost(&self) -> bool {
        self.of_device().is_some_and(GpuError::is_lost)
    }

    /// True if the device ran out of memory; a smaller request may succeed.
    pub fn is_out_of_memory(&self) -> bool {
        self.of_device().is_some_and(GpuError::is_out_of_memory)
    }

    /// True if a frame needs more than the device has memory for or than its buffers can hold. The viewer goes on with a
    /// view that needs less.
    pub fn is_too_much(&self) -> bool {
        self.is_out_of_memory() || matches!(self.of_rendering(), Some(RenderError::TooMany { .. }))
    }

    fn of_device(&self) -> Option<&GpuError> {
        match (self, self.of_rendering()) {
            (Self::Gpu(gpu), _) | (_, Some(RenderError::Gpu(gpu))) => Some(gpu),
            _ => None,
        }
    }

    fn of_rendering(&self) -> Option<&RenderError> {
        match self {
            Self::Render(error) | Self::Pages(FollowError::Render(error)) => Some(error),
            _ => None,
        }
    }
}

/// Why an edit, an undo or a redo was not carried out. After [`ChangeError::Rejected`] and [`ChangeError::Reverted`]
/// the viewer goes on with the scene as it was; after [`ChangeError::Failed`] it cannot.
#[derive(Debug, thiserror::Error)]
pub enum ChangeError {
    /// The edit is not possible in this scene.
    #[error(transparent)]
    Rejected(EditError),
    /// The device refused the changed scene, for instance for lack of memory, and the change was reverted.
    #[error(transparent)]
    Reverted(PlayerError),
    /// The device is lost, or refused the reverted scene as well.
    #[error(transparent)]
    Failed(#[from] PlayerError),
}

impl ChangeError {
    /// The text for the user if the viewer goes on.
    ///
    /// # Errors
    /// The error in [`ChangeError::Failed`].
    pub fn notice(self) -> Result<String, PlayerError> {
        match self {
            Self::Rejected(error) => Ok(error.to_string()),
            Self::Reverted(error) => Ok(error.to_string()),
            Self::Failed(error) => Err(error),
        }
    }
}
