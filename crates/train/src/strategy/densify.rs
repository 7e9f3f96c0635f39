//! INRIA's densification: clones and splits where gradients are large, prunes useless Gaussians, resets opacities.

use crate::config::TrainConfig;
use crate::device_state::DeviceState;
use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::{Buffer, GpuError};
use instgs_vk::kernels::{densify_mark, densify_place, densify_select, densify_split, reset_opacity as reset_kernel};
use instgs_vk::render::RenderError;
use instgs_vk::render::scan::ScanInput;
use instgs_vk::render::sort::SortBuffers;
use instgs_vk::scene::Parameter;

use super::tools::{Moves, Tools};
use super::{DensifyOutcome, logit, seed_words};

/// The thresholds of one densification.
#[derive(Clone, Debug)]
pub(super) struct Limits {
    mark: densify_mark::Params,
    max_gaussians: u32,
    seed: [u32; 2],
    done: u64,
}

impl Limits {
    /// The thresholds after `done` steps, for a scene of extent `extent` (scene units).
    pub(super) fn new(config: &TrainConfig, done: u64, extent: f64) -> Self {
        let densify = &config.densify;
        let large = config.prunes_large_at(done);
        let limit = |value: f64| if large && value > 0.0 { value } else { f64::INFINITY };
        // Finite, as some drivers do not support infinities.
        let finite = |value: f64| value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32;
        Self {
            mark: densify_mark::Params {
                count: 0,
                split_count: densify.split_count,
                gradient_threshold: densify.gradient_threshold as f32,
                log_scale_split: finite((densify.split_fraction * extent).ln()),
                log_shrink: densify.split_shrink.ln() as f32,
                logit_min: logit(densify.opacity_min),
                log_scale_max: finite((limit(densify.world_size_max) * extent).ln()),
                radius_max_px: finite(limit(densify.screen_size_max_px)),
            },
            max_gaussians: config.max_gaussians,
            seed: seed_words(config.seed),
            done,
        }
    }
}

/// The fate of each old Gaussian, one entry each.
struct Fates {
    /// Number of new Gaussians that it becomes.
    counts: Buffer<u32>,
    /// How it grows, one of the constants `GROWTH_*`.
    growths: Buffer<u32>,
    /// Index of the first of its new Gaussians.
    firsts: Buffer<u32>,
}

/// Clones, splits and prunes Gaussians.
pub(super) fn densify(
    tools: &mut Tools,
    state: &mut DeviceState,
    limits: &Limits,
) -> Result<DensifyOutcome, RenderError> {
    assert_eq!(state.scene.counts.templates, 0, "only plain clouds change their number of Gaussians");
    let before = state.source_count as u32;
    let (fates, counters) = decide(tools, state, limits)?;
    let [cloned, split, after] = [COUNTER_CLONED, COUNTER_SPLIT, COUNTER_DENSIFIED].map(|slot| counters[slot as usize]);
    if after == 0 {
        let reason = format!(
            "none of {before} Gaussians would be left after {} steps (opacity too low, too large, or not finite): check \
             densify.opacity_min, densify.world_size_max and the learning rates",
            limits.done
        );
        return Err(RenderError::Option { option: "densify", reason });
    }
    let moves = place(tools, &fates, before, after)?;
    drop(fates);
    tools.move_arrays(state, &moves)?;
    split_children(tools, state, &moves, limits)?;
    tools.finish(state, after)?;
    let grown = u64::from(before) + u64::from(cloned) + u64::from(split) * u64::from(limits.mark.split_count - 1);
    let pruned = (grown - u64::from(after)) as u32;
    Ok(DensifyOutcome { cloned, split, pruned, gaussians: after, ..Default::default() })
}

/// Decides the fate of each Gaussian; returns the fates and the counters.
fn decide(tools: &mut Tools, state: &DeviceState, limits: &Limits) -> Result<(Fates, Vec<u32>), GpuError> {
    let count = state.source_count as u32;
    let list = |name: &str| Buffer::<u32>::new(&tools.gpu, name, count as usize);
    let mut fates = Fates { counts: list("counts")?, growths: list("growths")?, firsts: list("firsts")? };
    let mut gains = list("gains")?;
    let mut sort = SortBuffers::new(&tools.gpu, "gradient", count as usize)?;
    let mut tables = tools.sort_tables(count)?;
    let mut scratch = tools.scratch(count)?;
    record_mark(tools, state, limits, &mut sort, &mut gains, &mut fates)?;
    tools.record_scan(&mut scratch, Some(COUNTER_KEPT), ScanInput::in_order(&fates.counts), &mut fates.firsts)?;
    tools.record_sort(&mut scratch, &mut tables, &mut sort)?;
    // In the order of gradients; the list of the sort has served.
    let order = ScanInput { values: &gains, indices: Some(&sort.values) };
    tools.record_scan(&mut scratch, None, order, &mut sort.keys)?;
    let bindings = densify_select::Bindings {
        order: &sort.values,
        gains: &gains,
        gains_before: &sort.keys,
        counts: &mut fates.counts,
        growths: &mut fates.growths,
        counters: &mut scratch.counters,
    };
    let params = densify_select::Params { count, max_gaussians: limits.max_gaussians };
    let grid = tools.threads(count);
    tools.recorder.dispatch(&tools.pipelines.densify_select, grid, &params, bindings)?;
    tools.record_scan(&mut scratch, Some(COUNTER_DENSIFIED), ScanInput::in_order(&fates.counts), &mut fates.firsts)?;
    tools.run()?;
    let counters = tools.counters(&scratch)?;
    Ok((fates, counters))
}

fn record_mark(
    tools: &mut Tools,
    state: &DeviceState,
    limits: &Limits,
    sort: &mut SortBuffers,
    gains: &mut Buffer<u32>,
    fates: &mut Fates,
) -> Result<(), GpuError> {
    let parameters = &state.scene.parameters;
    let count = state.source_count as u32;
    let bindings = densify_mark::Bindings {
        means: &parameters.means,
        quats: &parameters.quats,
        log_scales: &parameters.log_scales,
        opacity_logits: &parameters.opacity_logits,
        sh0: &parameters.sh0,
        sh1: &parameters.sh1,
        sh2: &parameters.sh2,
        sh3: &parameters.sh3,
        screen_statistics: &state.gradients.screen_statistics,
        keys: &mut sort.keys,
        values: &mut sort.values,
        counts: &mut fates.counts,
        gains,
        growths: &mut fates.growths,
    };
    let params = densify_mark::Params { count, ..limits.mark };
    let grid = tools.threads(count);
    tools.recorder.dispatch(&tools.pipelines.densify_mark, grid, &params, bindings)
}

/// Lists the new Gaussians with their origins.
fn place(tools: &mut Tools, fates: &Fates, before: u32, after: u32) -> Result<Moves, GpuError> {
    let mut moves = Moves::new(&tools.gpu, after)?;
    let bindings = densify_place::Bindings {
        counts: &fates.counts,
        growths: &fates.growths,
        firsts: &fates.firsts,
        origins: &mut moves.origins,
        made: &mut moves.made,
    };
    let grid = tools.threads(before);
    let params = densify_place::Params { count: before };
    tools.recorder.dispatch(&tools.pipelines.densify_place, grid, &params, bindings)?;
    tools.run()?;
    Ok(moves)
}

fn split_children(tools: &mut Tools, state: &mut DeviceState, moves: &Moves, limits: &Limits) -> Result<(), GpuError> {
    let parameters = &mut state.scene.parameters;
    let bindings = densify_split::Bindings {
        origins: &moves.origins,
        made: &moves.made,
        quats: &parameters.quats,
        means: &mut parameters.means,
        log_scales: &mut parameters.log_scales,
    };
    let params = densify_split::Params {
        count: moves.count,
        log_shrink: limits.mark.log_shrink,
        seed: limits.seed,
        time: limits.done as u32,
    };
    let grid = tools.threads(moves.count);
    tools.recorder.dispatch(&tools.pipelines.densify_split, grid, &params, bindings)?;
    tools.run()
}

/// Lowers all opacities to at most `opacity`.
pub(super) fn reset_opacity(tools: &mut Tools, state: &mut DeviceState, opacity: f64) -> Result<(), GpuError> {
    let count = state.source_count as u32;
    let bindings = reset_kernel::Bindings {
        opacity_logits: &mut state.scene.parameters.opacity_logits,
        moments: &mut state.moments.parameters[Parameter::OpacityLogits],
    };
    let grid = tools.threads(count);
    let params = reset_kernel::Params { count, logit_max: logit(opacity) };
    tools.recorder.dispatch(&tools.pipelines.reset_opacity, grid, &params, bindings)?;
    tools.run()
}
