//! How the number of Gaussians of a plain cloud changes, between steps and on the device.
//!
//! The host reads a handful of counters at each change, and nothing per Gaussian. Arrays move one at a time: besides the
//! state there is one copy of the largest array, and no gradients. Decisions are integers or comparisons of f32, sums
//! are scans, random numbers are hashes of (seed, steps done, Gaussian): the same seed gives the same bytes.

mod densify;
mod mcmc;
mod mcmc_step;
mod tools;

pub use mcmc_step::McmcStep;

use std::sync::Arc;

use instgs_vk::gpu::Gpu;
use instgs_vk::render::{RenderError, TrainFrame};

use super::config::{self, TrainConfig};
use super::device_state::{DeviceState, most_in_training};
use tools::Tools;

/// What a change of the Gaussians did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DensifyOutcome {
    /// Gaussians that got a copy.
    pub cloned: u32,
    /// Gaussians that smaller ones replaced.
    pub split: u32,
    /// Gaussians that are gone, split ones not counted.
    pub pruned: u32,
    /// Dead Gaussians that were moved onto others.
    pub relocated: u32,
    /// New Gaussians on others (the strategy `mcmc`).
    pub added: u32,
    /// Gaussians afterwards.
    pub gaussians: u32,
    /// True if opacities were lowered.
    pub opacity_reset: bool,
    /// True if there are now as many as the device has room for, and the configuration would let there be more.
    pub device_full: bool,
}

/// The strategy of a run, with its pipelines.
pub struct Strategy {
    tools: Tools,
}

impl Strategy {
    /// For states whose background has SH degree `sh_degree`.
    ///
    /// # Errors
    /// The device refuses a kernel.
    pub fn new(gpu: &Arc<Gpu>, frame: &TrainFrame, sh_degree: u32) -> Result<Self, RenderError> {
        Ok(Self { tools: Tools::new(gpu, frame.pipeline_cache(), frame.variant(), sh_degree)? })
    }

    /// Does what is due once `done` steps are finished; to be called when no step is in flight. `extent` is the scene's,
    /// scene units. `None` if nothing was due. A cloud grows no further than the device's bindings have room for.
    ///
    /// # Errors
    /// No Gaussian would be left: then nothing has changed. The device ran out of memory or
    /// failed: then the state is lost, since arrays are replaced one at a time.
    ///
    /// # Panics
    /// If something is due and the scene has templates.
    pub fn after_step(
        &mut self,
        state: &mut DeviceState,
        config: &TrainConfig,
        done: u64,
        extent: f64,
    ) -> Result<Option<DensifyOutcome>, RenderError> {
        let most = most_in_training(self.tools.gpu.caps().max_storage_bytes, state.scene.counts.background_sh_degree);
        let limited = TrainConfig { max_gaussians: config.max_gaussians.min(most), ..config.clone() };
        let mut outcome = self.change(state, &limited, done, extent)?;
        if let Some(outcome) = &mut outcome {
            // What splits takes the room of its children or stays as it is.
            let room = config.densify.split_count.saturating_sub(2);
            outcome.device_full = most < config.max_gaussians && outcome.gaussians.saturating_add(room) >= most;
        }
        Ok(outcome)
    }

    fn change(
        &mut self,
        state: &mut DeviceState,
        config: &TrainConfig,
        done: u64,
        extent: f64,
    ) -> Result<Option<DensifyOutcome>, RenderError> {
        let mut outcome = None;
        if config.densifies_at(done) && config.strategy == config::Strategy::Densify {
            outcome = Some(densify::densify(&mut self.tools, state, &densify::Limits::new(config, done, extent))?);
        }
        if config.densifies_at(done) && config.strategy == config::Strategy::Mcmc {
            outcome = Some(mcmc::relocate(&mut self.tools, state, config, done)?);
        }
        if config.resets_opacity_at(done) {
            densify::reset_opacity(&mut self.tools, state, config.densify.opacity_reset_to)?;
            let gaussians = state.source_count as u32;
            outcome.get_or_insert(DensifyOutcome { gaussians, ..Default::default() }).opacity_reset = true;
        }
        Ok(outcome)
    }
}

/// The two words of a seed, low word first.
fn seed_words(seed: u64) -> [u32; 2] {
    [seed as u32, (seed >> 32) as u32]
}

/// The logit of a probability, within the range where f32 still tells it from 0 and 1.
fn logit(probability: f64) -> f32 {
    (probability / (1.0 - probability)).ln().clamp(-80.0, 80.0) as f32
}
