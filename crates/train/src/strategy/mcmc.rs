//! Relocation and growth of "3D Gaussian Splatting as Markov Chain Monte Carlo" (Kheradmand et al. 2024): dead
//! Gaussians move onto live ones, and new ones are added there. Both are drawn at once; the authors' code draws them
//! one after the other.

use crate::config::TrainConfig;
use crate::device_state::DeviceState;
use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::{Buffer, GpuError};
use instgs_vk::kernels::{mcmc_gather_copies, mcmc_pick, mcmc_share, mcmc_weigh};
use instgs_vk::render::RenderError;
use instgs_vk::render::scan::ScanInput;

use super::tools::{Moves, Tools};
use super::{DensifyOutcome, logit, seed_words};

/// Integer weight of opacity 1: f32 opacities have no more digits that matter for drawing.
const FINEST_WEIGHT: u32 = 1 << 20;

/// Relocates dead Gaussians and adds new ones.
pub(super) fn relocate(
    tools: &mut Tools,
    state: &mut DeviceState,
    config: &TrainConfig,
    done: u64,
) -> Result<DensifyOutcome, RenderError> {
    assert_eq!(state.scene.counts.templates, 0, "only plain clouds change their number of Gaussians");
    let before = state.source_count() as u32;
    let grown = (config.mcmc.growth * f64::from(before)) as u32;
    let after = grown.min(config.max_gaussians).max(before);
    let logit_min = logit(config.mcmc.opacity_min);
    let params = mcmc_pick::Params { count: before, after, seed: seed_words(config.seed), time: done as u32 };
    if before == 0 {
        return Ok(DensifyOutcome::default());
    }
    let (moves, relocated) = pick(tools, state, params, logit_min)?;
    if relocated == before {
        let reason = format!(
            "all {before} Gaussians have opacities up to mcmc.opacity_min = {} or are not finite after {done} steps: \
             check mcmc.opacity_regularisation and the learning rates",
            config.mcmc.opacity_min
        );
        return Err(RenderError::Option { option: "mcmc", reason });
    }
    if relocated > 0 || after > before {
        tools.move_arrays(state, &moves, None)?;
        share(tools, state, &moves, logit_min)?;
    }
    let mut layout = state.layout.clone();
    layout.background.len = after as usize;
    state.relayout(&tools.gpu, layout)?;
    Ok(DensifyOutcome { relocated, added: after - before, gaussians: after, ..Default::default() })
}

/// Draws the Gaussians that dead and new ones go to; returns them and the number of dead ones.
fn pick(
    tools: &mut Tools,
    state: &DeviceState,
    params: mcmc_pick::Params,
    logit_min: f32,
) -> Result<(Moves, u32), GpuError> {
    let (count, after) = (params.count, params.after);
    let list = |name: &str| Buffer::<u32>::new(&tools.gpu, name, count as usize);
    let (mut weights, mut sums, mut copies) = (list("weights")?, list("weights before")?, list("copies")?);
    let mut moves = Moves::new(&tools.gpu, after)?;
    let mut scratch = tools.scratch(count)?;
    record_weigh(tools, state, logit_min, &mut weights, &mut copies)?;
    tools.record_scan(&mut scratch, Some(COUNTER_WEIGHTS), ScanInput::in_order(&weights), &mut sums)?;
    let bindings = mcmc_pick::Bindings {
        weights: &weights,
        before: &sums,
        origins: &mut moves.origins,
        copies: &mut copies,
        counters: &mut scratch.counters,
    };
    let grid = tools.threads(after);
    tools.recorder.dispatch(&tools.pipelines.mcmc_pick, grid, &params, bindings)?;
    let bindings = mcmc_gather_copies::Bindings { origins: &moves.origins, copies: &copies, made: &mut moves.made };
    let params = mcmc_gather_copies::Params { after };
    tools.recorder.dispatch(&tools.pipelines.mcmc_gather_copies, grid, &params, bindings)?;
    tools.run()?;
    let relocated = tools.counters(&scratch)?[COUNTER_RELOCATED as usize];
    Ok((moves, relocated))
}

fn record_weigh(
    tools: &mut Tools,
    state: &DeviceState,
    logit_min: f32,
    weights: &mut Buffer<u32>,
    copies: &mut Buffer<u32>,
) -> Result<(), GpuError> {
    let parameters = &state.scene.parameters;
    let count = state.source_count() as u32;
    let one = FINEST_WEIGHT.min(u32::MAX / count.max(1));
    for window in state.scene.windows.iter() {
        let bindings = mcmc_weigh::Bindings {
            means: &parameters.means,
            quats: &parameters.quats,
            log_scales: &parameters.log_scales,
            opacity_logits: &parameters.opacity_logits,
            sh0: &parameters.sh0,
            sh1: &parameters.sh1,
            sh2: &parameters.sh2,
            sh3: &parameters.sh3,
            weights: &mut *weights,
            copies: &mut *copies,
        };
        let first = window.shown.first;
        debug_assert!(window.bands_begin_alike(state.scene.sh_degree), "all Gaussians have the same SH bands");
        let count = window.shown.count.min(count - first);
        let params = mcmc_weigh::Params { first, count, one, logit_min };
        let (grid, parts) = (tools.threads(count), state.scene.parts(&window));
        tools.recorder.dispatch_parts(&tools.pipelines.mcmc_weigh, grid, &params, bindings, &parts)?;
    }
    Ok(())
}

/// Divides opacity and size among the Gaussians at one position.
fn share(tools: &mut Tools, state: &mut DeviceState, moves: &Moves, logit_min: f32) -> Result<(), GpuError> {
    let bindings = mcmc_share::Bindings {
        made: &moves.made,
        opacity_logits: &mut state.scene.parameters.opacity_logits,
        log_scales: &mut state.scene.parameters.log_scales,
    };
    let params = mcmc_share::Params { count: moves.count, logit_min };
    let grid = tools.threads(moves.count);
    tools.recorder.dispatch(&tools.pipelines.mcmc_share, grid, &params, bindings)?;
    tools.run()
}
