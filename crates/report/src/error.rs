//! The errors of the pictures of a run.

use instgs_io::IoError;
use instgs_vk::render::RenderError;

/// Each error is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file of the run or of its data set is missing or damaged, or a file cannot be written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A picture cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
}
