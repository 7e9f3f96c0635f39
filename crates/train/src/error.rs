//! The error of a training run that ended early.

use std::path::PathBuf;

use instgs_eval::EvalError;
use instgs_io::IoError;
use instgs_vk::gpu::GpuError;
use instgs_vk::render::RenderError;

/// Each error is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The device failed or is too small.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A configuration that cannot be written down.
    #[error(transparent)]
    Config(#[from] super::config::ConfigError),
    /// The evaluation of test views.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// A step failed; `saved` is the checkpoint that was written before giving up.
    #[error("step {step}: {error}{}{}", remedy.as_ref().map(|remedy| format!("; {remedy}")).unwrap_or_default(), saved.as_ref().map(|p| format!("; the state before it is in {}, continue with --resume", p.display())).unwrap_or_default())]
    Step {
        /// Number of finished steps.
        step: u64,
        /// The error of the step.
        error: Box<TrainError>,
        /// What would fit, if memory ran out.
        remedy: Option<String>,
        /// The checkpoint to resume from, if one could be written.
        saved: Option<PathBuf>,
    },
    /// The scene cannot be trained or shown.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A run cannot be resumed, since its photos, masks or cameras are not those of the checkpoint.
    #[error("{change}; the data set is not that of the checkpoint of step {step} ({count} {}): restore it, or continue on the changed one with --accept-changed-data", if *count == 1 { "change" } else { "changes" })]
    DataChanged {
        /// The first change, with its file.
        change: String,
        /// Number of changes.
        count: usize,
        /// Number of finished steps of the checkpoint.
        step: u64,
    },
    /// There is no view to train on.
    #[error("there are no training views")]
    NoViews,
    /// No training view has this index.
    #[error("view {0} is not among the training views")]
    UnknownView(usize),
    /// The view with this index was asked for out of order and is not on the device.
    #[error("view {0} was not read ahead")]
    NotPrefetched(usize),
    /// Every Gaussian became non-finite.
    #[error("after {steps} steps no finite Gaussian is left: lower the learning rates, and train into another folder")]
    NothingLeft {
        /// Number of finished steps.
        steps: u64,
    },
    /// Every Gaussian was too transparent to keep.
    #[error(
        "after {steps} steps no Gaussian has more opacity than joint.prune_opacity = {opacity}: set a lower one, and continue with --resume"
    )]
    AllPruned {
        /// Number of finished steps.
        steps: u64,
        /// The least opacity to keep.
        opacity: f64,
    },
}

impl TrainError {
    /// Bytes of device memory that were missing, if that is the error.
    pub(super) fn missing_bytes(&self) -> Option<u64> {
        match self {
            Self::Gpu(GpuError::OutOfMemory { missing, .. })
            | Self::Render(RenderError::Gpu(GpuError::OutOfMemory { missing, .. })) => Some(*missing),
            Self::Eval(EvalError::Render {
                error: RenderError::Gpu(GpuError::OutOfMemory { missing, .. }), ..
            }) => Some(*missing),
            _ => None,
        }
    }
}
