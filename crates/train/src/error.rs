//! Why a training run ended early.

use std::path::PathBuf;

use instgs_eval::EvalError;
use instgs_io::IoError;
use instgs_vk::gpu::GpuError;
use instgs_vk::render::RenderError;

/// One line for the user each.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A file.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A configuration that cannot be written down.
    #[error(transparent)]
    Config(#[from] super::config::ConfigError),
    /// The evaluation of test views.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// A step; `saved` is the checkpoint that was written before giving up.
    #[error("step {step}: {error}{}", saved.as_ref().map(|p| format!("; the state before it is in {}, continue with --resume", p.display())).unwrap_or_default())]
    Step {
        /// Finished steps.
        step: u64,
        /// What is wrong.
        error: Box<TrainError>,
        /// Where to go on from.
        saved: Option<PathBuf>,
    },
    /// The scene cannot be trained or shown.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Something about the run folder or the data, in words.
    #[error("{0}")]
    Other(String),
}
