//! Why the pipeline from photos to an instanced scene ended early.

use crate::detect::DetectError;
use crate::io::IoError;
use crate::register::RegisterError;
use crate::render::RenderError;
use crate::segment::SegmentError;
use crate::template::TemplateError;
use crate::train::TrainError;

/// One line for the user each.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// A file that is missing, damaged, or cannot be written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// Training of the plain cloud, or the joint phase.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// Masks could not be made from words.
    #[error(transparent)]
    Detect(#[from] DetectError),
    /// A scene that the device cannot render.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Which Gaussian belongs to which object.
    #[error(transparent)]
    Segment(#[from] SegmentError),
    /// Which objects are alike, and where they stand.
    #[error(transparent)]
    Register(#[from] RegisterError),
    /// Templates from groups.
    #[error(transparent)]
    Template(#[from] TemplateError),
}
