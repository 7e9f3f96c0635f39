//! The additions of the strategy `mcmc` to every step: two regularisers before Adam, noise on the centres after it.

use crate::config::{self, Rates, TrainConfig};
use crate::device_state::DeviceState;
use instgs_vk::gpu::{GpuError, Grid, Recorder};
use instgs_vk::kernels::{McmcStepPipelines, mcmc_noise, mcmc_regularise};
use instgs_vk::render::StepLog;

use super::seed_words;

/// Weights and noise of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct McmcStep {
    /// Seed of the run's random choices.
    pub seed: u64,
    /// Noise on the centres per covariance, 1 / scene units.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity_weight: f64,
    /// Weight of the mean scale in the loss, 1 / scene units.
    pub scale_weight: f64,
}

impl McmcStep {
    /// The values of a step with these learning rates; `None` if the configuration has another strategy.
    pub fn new(config: &TrainConfig, rates: &Rates) -> Option<Self> {
        (config.strategy == config::Strategy::Mcmc).then_some(Self {
            seed: config.seed,
            noise: config.mcmc.noise * rates.background.means,
            opacity_weight: config.mcmc.opacity_regularisation,
            scale_weight: config.mcmc.scale_regularisation,
        })
    }

    /// Records the regularisers: after the backward pass, before Adam. Nothing happens on the device after an overflow.
    pub fn record_regularisation(
        &self,
        recorder: &mut Recorder,
        pipelines: &McmcStepPipelines,
        workgroup_size: u32,
        log: &StepLog,
        state: &mut DeviceState,
    ) -> Result<(), GpuError> {
        let count = state.source_count();
        if count == 0 {
            return Ok(());
        }
        let params = mcmc_regularise::Params {
            count: count as u32,
            opacity_weight: (self.opacity_weight / count as f64) as f32,
            scale_weight: (self.scale_weight / (3 * count) as f64) as f32,
        };
        let bindings = mcmc_regularise::Bindings {
            status: &log.status,
            log_scales: &state.scene.parameters.log_scales,
            opacity_logits: &state.scene.parameters.opacity_logits,
            log_scale_gradients: &mut state.gradients.parameters.log_scales,
            opacity_logit_gradients: &mut state.gradients.parameters.opacity_logits,
        };
        recorder.dispatch(&pipelines.mcmc_regularise, Grid::threads(count as u32, workgroup_size), &params, bindings)
    }

    /// Records the noise of step index `step`: after Adam. Nothing happens on the device after an overflow.
    pub fn record_noise(
        &self,
        recorder: &mut Recorder,
        pipelines: &McmcStepPipelines,
        workgroup_size: u32,
        log: &StepLog,
        state: &mut DeviceState,
        step: u32,
    ) -> Result<(), GpuError> {
        let count = state.source_count() as u32;
        if count == 0 {
            return Ok(());
        }
        let params = mcmc_noise::Params { count, strength: self.noise as f32, seed: seed_words(self.seed), time: step };
        let parameters = &mut state.scene.parameters;
        let bindings = mcmc_noise::Bindings {
            status: &log.status,
            quats: &parameters.quats,
            log_scales: &parameters.log_scales,
            opacity_logits: &parameters.opacity_logits,
            means: &mut parameters.means,
        };
        recorder.dispatch(&pipelines.mcmc_noise, Grid::threads(count, workgroup_size), &params, bindings)
    }
}
