//! How the number of Gaussians changes, between steps and on the device. It is that of a plain cloud, or of a scene's templates,
//! instances' own Gaussians and background.
//!
//! The host reads a few counters at each change and where templates begin, and nothing per Gaussian. Arrays are reordered one at
//! a time: besides the state there is one copy of the largest array, and no gradients. Decisions are integers or comparisons of f32,
//! sums are scans, random numbers are hashes of (seed, finished steps, Gaussian): the same seed gives the same bytes.

mod densify;
mod mcmc;
mod mcmc_step;
mod own;
mod recycle;
mod tools;

pub use mcmc_step::McmcStep;

use std::sync::Arc;

use instgs_vk::gpu::Gpu;
use instgs_vk::render::{RenderError, TrainFrame};

use super::config::{self, TrainConfig};
use super::device_state::{DeviceState, most_in_training};
use tools::Tools;

/// Counts of one change of the Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DensifyOutcome {
    /// Gaussians that were cloned.
    pub cloned: u32,
    /// Gaussians that were split into smaller ones.
    pub split: u32,
    /// Gaussians that were removed, split ones not counted.
    pub pruned: u32,
    /// Gaussians that single instances got for their own.
    pub own: u32,
    /// Dead Gaussians that were moved onto live ones.
    pub relocated: u32,
    /// Gaussians added on live ones (the strategy `mcmc`).
    pub added: u32,
    /// Number of Gaussians afterwards.
    pub gaussians: u32,
    /// True if opacities were lowered.
    pub opacity_reset: bool,
    /// True if one more Gaussian of the template with the most instances fits the configuration, but not the device.
    pub device_full: bool,
}

/// The strategy of a run, with its pipelines.
pub struct Strategy {
    tools: Tools,
}

impl Strategy {
    /// A strategy for states whose background has SH degree `sh_degree`.
    ///
    /// # Errors
    /// The device refuses a kernel.
    pub fn new(gpu: &Arc<Gpu>, frame: &TrainFrame, sh_degree: u32) -> Result<Self, RenderError> {
        Ok(Self { tools: Tools::new(gpu, frame.pipeline_cache(), frame.variant(), sh_degree)? })
    }

    /// Changes the Gaussians if the schedule says so once `done` steps are finished; to be called when no step is in
    /// flight. `extent` is that of the scene, scene units. `None` if nothing was to be done. A cloud grows no further
    /// than the device's bindings have room for.
    ///
    /// # Errors
    /// No Gaussian would be left: then nothing has changed. The device ran out of memory or failed: then the state is
    /// lost, since arrays are replaced one at a time.
    ///
    /// # Panics
    /// If the strategy is `mcmc` and the scene has templates.
    pub fn after_step(
        &mut self,
        state: &mut DeviceState,
        config: &TrainConfig,
        done: u64,
        extent: f64,
    ) -> Result<Option<DensifyOutcome>, RenderError> {
        let most = self.most(state);
        let limited = TrainConfig { max_gaussians: config.max_gaussians.min(most), ..config.clone() };
        let mut outcome = self.change(state, &limited, done, extent)?;
        if let Some(outcome) = &mut outcome {
            let fits = densify::next_fits(state, config.densify.children(), most);
            outcome.device_full = most < config.max_gaussians && !fits;
        }
        Ok(outcome)
    }

    /// True if [`Strategy::after_step`] clones, splits, prunes or relocates Gaussians after `done` steps: when that is due, unless the
    /// scene is full and waits for recycling.
    pub fn densifies(&self, state: &DeviceState, config: &TrainConfig, done: u64, extent: f64) -> bool {
        if !config.densifies_at(done) || config.strategy == config::Strategy::Mcmc {
            return config.densifies_at(done);
        }
        let limited = TrainConfig { max_gaussians: config.max_gaussians.min(self.most(state)), ..config.clone() };
        densify::Limits::new(&limited, done, extent, state.statistics_since).has_room(state)
    }

    /// The largest number of expanded Gaussians that the device's bindings have room for.
    fn most(&self, state: &DeviceState) -> u32 {
        let most = most_in_training(self.tools.gpu.caps(), state.scene.sh_degree);
        // Every instance begins a chunk of its own, and another one for what it alone has.
        let rows = state.scene.posed_instances().saturating_mul(1 + u32::from(!state.layout.own_ranges.is_empty()));
        most.saturating_sub(rows.saturating_mul(state.scene.chunk_size))
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
            let limits = densify::Limits::new(config, done, extent, state.statistics_since);
            if limits.has_room(state) {
                outcome = Some(densify::densify(&mut self.tools, state, &limits)?);
            }
        }
        if outcome.is_some() && config.densify.opacity_decay > 0.0 {
            densify::decay_opacity(&mut self.tools, state, config.densify.opacity_decay)?;
        }
        if config.densifies_at(done) && config.strategy == config::Strategy::Mcmc {
            outcome = Some(mcmc::relocate(&mut self.tools, state, config, done)?);
        }
        if outcome.is_some() {
            state.statistics_since = Some(done);
        }
        if config.resets_opacity_at(done) {
            densify::reset_opacity(&mut self.tools, state, config.densify.opacity_reset_to)?;
            let gaussians = state.source_count() as u32;
            outcome.get_or_insert(DensifyOutcome { gaussians, ..Default::default() }).opacity_reset = true;
        }
        Ok(outcome)
    }
}

/// The two words of a seed, low word first.
fn seed_words(seed: u64) -> [u32; 2] {
    [seed as u32, (seed >> 32) as u32]
}

/// The logit of a probability, clamped to the range where f32 distinguishes it from 0 and 1.
fn logit(probability: f64) -> f32 {
    (probability / (1.0 - probability)).ln().clamp(-80.0, 80.0) as f32
}
