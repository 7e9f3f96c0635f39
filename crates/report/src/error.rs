//! Why pictures of a run could not be made.

use instgs_io::IoError;
use instgs_vk::render::RenderError;

/// One line for the user each.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file of the run or of its data set that is missing or damaged, or one that cannot be written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A picture that cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
}
