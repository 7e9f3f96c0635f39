//! Why the pipeline from photos to an instanced scene ended early.

use std::path::PathBuf;

use crate::register::RegisterError;
use crate::segment::SegmentError;
use crate::template::TemplateError;
use instgs_detect::DetectError;
use instgs_eval::EvalError;
use instgs_io::IoError;
use instgs_train::TrainError;
use instgs_train::config::ConfigError;
use instgs_vk::render::RenderError;

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
