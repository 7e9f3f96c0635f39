//! Everything a command can fail with; each displays as one line.

use crate::bench::{BenchError, LodError};
use crate::eval::EvalError;
use crate::gpu::GpuError;
use crate::io::IoError;
use crate::pipeline::PipelineError;
#[cfg(feature = "player")]
use crate::player::PlayerError;
use crate::render::RenderError;
use crate::synth::dataset::SynthError;
use crate::train::TrainError;
use crate::train::config::ConfigError;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// A file.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The Vulkan device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A frame; `place` is the scene's file or the view.
    #[error("{place}: {error}")]
    Render {
        /// Which scene or view.
        place: String,
        /// What is wrong.
        error: RenderError,
    },
    /// A comparison with photos.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// A measurement.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// A measurement of levels of detail.
    #[error(transparent)]
    Lod(#[from] LodError),
    /// A training run.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// What leads from photos and masks to an instanced scene.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// A configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The player.
    #[cfg(feature = "player")]
    #[error(transparent)]
    Player(#[from] PlayerError),
    /// A synthetic data set.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// Anything else, in words.
    #[error("{0}")]
    Other(String),
}

impl CliError {
    /// Names the scene or view that a rendering error belongs to.
    pub(super) fn render(place: impl std::fmt::Display) -> impl FnOnce(RenderError) -> Self {
        move |error| Self::Render { place: place.to_string(), error }
    }
}
