//! Why the pipeline from photos to an instanced scene ended early.

use std::path::PathBuf;

use crate::detect::DetectError;
use crate::eval::EvalError;
use crate::io::IoError;
use crate::register::RegisterError;
use crate::render::RenderError;
use crate::segment::SegmentError;
use crate::template::TemplateError;
use crate::train::TrainError;
use crate::train::config::ConfigError;

/// One line for the user each.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// A file that is missing, damaged, or cannot be written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// Training of the plain cloud, or the joint phase.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// A configuration that does not fit the run, or cannot be written down.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The figures of a given cloud.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// Someone asked to stop; a checkpoint was written.
    #[error("stopped after {steps} steps; continue with --data {} --out {} --resume", data.display(), out.display())]
    Interrupted {
        /// Finished steps.
        steps: u64,
        /// Dataset folder.
        data: PathBuf,
        /// Folder of the whole run.
        out: PathBuf,
    },
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
