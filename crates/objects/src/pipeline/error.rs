//! The error of a pipeline run that ended early.

use std::path::PathBuf;

use crate::register::RegisterError;
use crate::segment::SegmentError;
use crate::template::TemplateError;
use instgs_detect::DetectError;
use instgs_io::IoError;
use instgs_train::TrainError;
use instgs_train::config::ConfigError;
use instgs_vk::render::RenderError;

/// Each error is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum PipelineError {
    /// A file is missing, damaged, or cannot be written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// Training of the plain cloud or the joint phase failed, or the quality of a given cloud could not be measured.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// The configuration does not fit the run, or cannot be written down.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The run was asked to stop; a checkpoint was written.
    #[error("stopped after {steps} steps; continue with --data {} --out {} --resume", data.display(), out.display())]
    Interrupted {
        /// Number of finished steps.
        steps: u64,
        /// Folder of the data set.
        data: PathBuf,
        /// Folder of the whole run.
        out: PathBuf,
    },
    /// Masks could not be made from words.
    #[error(transparent)]
    Detect(#[from] DetectError),
    /// The device cannot render a scene.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Gaussians could not be labelled.
    #[error(transparent)]
    Segment(#[from] SegmentError),
    /// Objects could not be registered.
    #[error(transparent)]
    Register(#[from] RegisterError),
    /// Templates could not be built from the groups.
    #[error(transparent)]
    Template(#[from] TemplateError),
}
