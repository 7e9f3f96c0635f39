//! INRIA's densification: clones and splits where gradients are large, prunes useless Gaussians, resets opacities. In
//! scenes with templates the statistics are sums over instances, a copy inherits the offsets of its origin in every
//! instance, children divide what each instance shows of their parent, and a Gaussian is too transparent only if it is so in
//! all of them. What only some instances call for they get as Gaussians of their own (`own.rs`).

use std::collections::BTreeMap;

use crate::config::{Growth, TrainConfig};
use crate::device_state::DeviceState;
use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::staging::download_elements;
use instgs_vk::gpu::{Buffer, GpuError, Grid};
use instgs_vk::kernels::{
    decay_opacity as decay_kernel, densify_mark, densify_place, densify_place_offsets, densify_select, densify_split,
    densify_split_offsets, reset_opacity as reset_kernel, source_use,
};
use instgs_vk::render::RenderError;
use instgs_vk::render::scan::ScanInput;
use instgs_vk::render::sort::SortBuffers;
use instgs_vk::scene::source_layout::MovedRun;
use instgs_vk::scene::{Parameter, SourceLayout};

use super::recycle::Recycling;
use super::tools::{Moves, Tools, bits};
use super::{DensifyOutcome, logit, own, seed_words};

/// Opacity below which a decay lowers none: such a Gaussian shows nothing, and its logit must stay finite.
const LOWEST_DECAYED: f64 = 1e-4;

/// The thresholds of one densification.
#[derive(Clone, Debug)]
pub(super) struct Limits {
    mark: densify_mark::Params,
    /// What `densify_split` makes of a parent.
    split: densify_split::Params,
    /// True if means have offsets that training changes.
    means_have_offsets: bool,
    /// Upper bound of the number of expanded Gaussians.
    max_expanded: u32,
    /// Largest part of the instances that grow alone.
    pub(super) own_share: f32,
    /// True if something leaves a full scene from time to time, and nothing counts on more densifications than that.
    recycles: bool,
    /// What leaves a full cloud before it grows.
    recycling: Option<Recycling>,
    done: u64,
}

impl Limits {
    /// Mean screen gradient from which Gaussians grow.
    pub(super) fn gradient_threshold(&self) -> f32 {
        self.mark.gradient_threshold
    }

    /// False for a full scene until recycling makes room: hardly anything would grow, and what the statistics say would be lost.
    /// Gaussians that are too faint wait as well.
    pub(super) fn has_room(&self, state: &DeviceState) -> bool {
        let is_full = !next_fits(state, self.mark.split_count, self.max_expanded);
        !(is_full && self.recycles && self.recycling.is_none())
    }

    /// The thresholds after `done` steps, for a scene of extent `extent` (scene units) whose statistics are of the steps after `since`
    /// (see [`DeviceState::statistics_since`]).
    pub(super) fn new(config: &TrainConfig, done: u64, extent: f64, since: Option<u64>) -> Self {
        let densify = &config.densify;
        let large = config.prunes_large_at(done);
        let limit = |value: f64| if large && value > 0.0 { value } else { f64::INFINITY };
        // Finite, as some drivers do not support infinities.
        let finite = |value: f64| value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32;
        let halves = densify.growth == Growth::Halves;
        let log_shrink = densify.split_shrink.ln() as f32;
        // Halves are never cloned.
        let split_above = if halves { 0.0 } else { densify.split_fraction * extent };
        Self {
            mark: densify_mark::Params {
                first: 0,
                count: 0,
                split_count: densify.children(),
                halves: u32::from(halves),
                gradient_threshold: densify.gradient_threshold as f32,
                log_scale_split: finite(split_above.ln()),
                log_shrink,
                logit_min: logit(densify.opacity_min),
                log_scale_max: finite((limit(densify.world_size_max) * extent).ln()),
                radius_max_px: finite(limit(densify.screen_size_max_px)),
            },
            split: densify_split::Params {
                count: 0,
                log_shrink,
                seed: seed_words(config.seed),
                time: done as u32,
                halves: u32::from(halves),
                distance: densify.halves().distance() as f32,
                opacity: if halves { densify.half_opacity as f32 } else { 1.0 },
            },
            means_have_offsets: config.offsets.position,
            max_expanded: config.max_gaussians,
            own_share: config.joint.own_share as f32,
            recycles: densify.recycle > 0.0 && densify.opacity_decay == 0.0 && densify.opacity_reset_every == 0,
            recycling: Recycling::due(config, done, since),
            done,
        }
    }
}

/// True if any Gaussian may still be split into `children` without more than `most` expanded ones: growth ends where the next one does
/// not fit, which may be one of the template with the most instances.
pub(super) fn next_fits(state: &DeviceState, children: u32, most: u32) -> bool {
    let of_one = u64::from(state.tables.most_instances.max(1)) * u64::from(children.saturating_sub(1));
    state.layout.expanded_len() + of_one <= u64::from(most)
}

/// The fate of each old Gaussian, one entry each.
pub(super) struct Fates {
    /// Number of new Gaussians that it becomes, those of instances' own not counted.
    pub(super) counts: Buffer<u32>,
    /// How it grows, one of the constants `GROWTH_*`.
    pub(super) growths: Buffer<u32>,
    /// Index of the first of its new Gaussians, before instances' own are inserted.
    pub(super) firsts: Buffer<u32>,
}

/// Clones, splits and prunes Gaussians.
pub(super) fn densify(
    tools: &mut Tools,
    state: &mut DeviceState,
    limits: &Limits,
) -> Result<DensifyOutcome, RenderError> {
    let before = state.source_count() as u32;
    let mut needs = own::Needs::find(tools, state, limits)?;
    let (fates, counters) = decide(tools, state, limits, &needs)?;
    let [cloned, split, after] = [COUNTER_CLONED, COUNTER_SPLIT, COUNTER_DENSIFIED].map(|slot| counters[slot as usize]);
    if after == 0 {
        let reason = format!(
            "none of {before} Gaussians would be left after {} steps (opacity too low, too large, or not finite): check \
             densify.opacity_min, densify.world_size_max, max_gaussians, joint.max_expanded and the learning rates",
            limits.done
        );
        return Err(RenderError::Option { option: "densify", reason });
    }
    let gains = needs.select(tools, state, &fates)?;
    let boundaries = moved_boundaries(tools, state, &fates, after)?;
    let (layout, runs) = state.layout.after_moves(|i| boundaries[&i], &gains.by_instance);
    let inserted = gains.inserted(&state.layout, &layout);
    let mut moves = place(tools, state, &fates, layout.source_count() as u32, &gains)?;
    needs.place(tools, &fates, &inserted, &mut moves)?;
    let offset_moves = if runs.is_empty() { None } else { Some(place_offsets(tools, state, &moves, &layout, &runs)?) };
    // Every array is copied once: what has served makes room first.
    let kept_for_own = (!inserted.is_empty()).then_some((needs, fates));
    tools.move_arrays(state, &moves, offset_moves.as_ref())?;
    state.scene.fit_windows(&tools.gpu, &layout)?;
    if let Some((needs, fates)) = kept_for_own {
        needs.apply_offsets(tools, state, &fates, &inserted)?;
    }
    split_offsets(tools, state, &moves, &layout, &runs, limits)?;
    split_children(tools, state, &moves, limits)?;
    let gaussians = layout.source_count() as u32;
    state.relayout(&tools.gpu, layout)?;
    let grown = u64::from(before) + u64::from(cloned) + u64::from(split) * u64::from(limits.mark.split_count - 1);
    let pruned = (grown - u64::from(after)) as u32;
    Ok(DensifyOutcome { cloned, split, pruned, own: gaussians - after, gaussians, ..Default::default() })
}

/// What `densify_mark` and `densify_select` share besides the fates, by old Gaussian.
struct Gains {
    /// Gaussians added by growth.
    gains: Buffer<u32>,
    /// The same, once per instance.
    gains_expanded: Buffer<u32>,
    /// Number of expanded Gaussians that stay without growth.
    kept_expanded: Buffer<u32>,
}

/// Decides the fate of each Gaussian; returns the fates and the counters.
fn decide(
    tools: &mut Tools,
    state: &DeviceState,
    limits: &Limits,
    needs: &own::Needs,
) -> Result<(Fates, Vec<u32>), GpuError> {
    let count = state.source_count() as u32;
    let gpu = tools.gpu.clone();
    let list = |name: &str| Buffer::<u32>::new(&gpu, name, count as usize);
    let mut fates = Fates { counts: list("counts")?, growths: list("growths")?, firsts: list("firsts")? };
    let (gains, gains_expanded, kept_expanded) = (list("gains")?, list("gains_expanded")?, list("kept_expanded")?);
    let mut gains = Gains { gains, gains_expanded, kept_expanded };
    let mut sort = SortBuffers::new(&tools.gpu, "gradient", count as usize)?;
    let mut tables = tools.sort_tables(count)?;
    let mut scratch = tools.scratch(count)?;
    record_mark(tools, state, limits, needs, &mut sort, &mut gains, &mut fates)?;
    let kept = ScanInput::in_order(&gains.kept_expanded);
    tools.record_scan(&mut scratch, Some(COUNTER_KEPT), kept, &mut fates.firsts)?;
    tools.record_sort(&mut scratch, &mut tables, &mut sort)?;
    // In the order of gradients; the list of the sort has served.
    let order = ScanInput { values: &gains.gains_expanded, indices: Some(&sort.values) };
    tools.record_scan(&mut scratch, None, order, &mut sort.keys)?;
    let bindings = densify_select::Bindings {
        order: &sort.values,
        gains: &gains.gains,
        gains_expanded: &gains.gains_expanded,
        gains_before: &sort.keys,
        counts: &mut fates.counts,
        growths: &mut fates.growths,
        counters: &mut scratch.counters,
    };
    let params = densify_select::Params { count, max_expanded: limits.max_expanded };
    let grid = tools.threads(count);
    tools.recorder.dispatch(&tools.pipelines.densify_select, grid, &params, bindings)?;
    tools.record_scan(&mut scratch, Some(COUNTER_DENSIFIED), ScanInput::in_order(&fates.counts), &mut fates.firsts)?;
    tools.run()?;
    let counters = tools.counters(&scratch)?;
    Ok((fates, counters))
}

/// How every source Gaussian is used, one entry each: what kernel `source_use` writes.
struct SourceUses {
    uses: Buffer<u32>,
    highest_logits: Buffer<f32>,
    log_world_scales: Buffer<f32>,
    felt: Buffer<f32>,
}

fn record_source_uses(tools: &mut Tools, state: &DeviceState) -> Result<SourceUses, GpuError> {
    let parameters = &state.scene.parameters;
    let count = state.source_count();
    let mut out = SourceUses {
        uses: Buffer::new(&tools.gpu, "uses", count)?,
        highest_logits: Buffer::new(&tools.gpu, "highest_logits", count)?,
        log_world_scales: Buffer::new(&tools.gpu, "log_world_scales", count)?,
        felt: Buffer::new(&tools.gpu, "felt", count)?,
    };
    // A Gaussian of no template is used by no instance, and shown by none.
    tools.recorder.fill(&mut out.uses, 0)?;
    tools.recorder.fill(&mut out.highest_logits, f32::MIN.to_bits())?;
    tools.recorder.fill(&mut out.log_world_scales, 0)?;
    tools.recorder.fill(&mut out.felt, 0)?;
    let bindings = source_use::Bindings {
        source_chunks: &state.tables.chunks,
        instance_from_template: &state.tables.instance_from_template,
        instances: &state.scene.instances,
        opacity_logits: &parameters.opacity_logits,
        offset_opacity_logits: &parameters.offset_opacity_logits,
        uses: &mut out.uses,
        highest_logits: &mut out.highest_logits,
        log_world_scales: &mut out.log_world_scales,
        logit_moments: &state.moments.parameters[Parameter::OpacityLogits],
        offset_logit_moments: &state.moments.parameters[Parameter::OffsetOpacityLogits],
        felt: &mut out.felt,
    };
    let params = source_use::Params { chunk_count: state.tables.chunk_count };
    let grid = Grid::groups(state.tables.chunk_count);
    tools.recorder.dispatch(&tools.pipelines.source_use, grid, &params, bindings)?;
    Ok(out)
}

fn record_mark(
    tools: &mut Tools,
    state: &DeviceState,
    limits: &Limits,
    needs: &own::Needs,
    sort: &mut SortBuffers,
    gains: &mut Gains,
    fates: &mut Fates,
) -> Result<(), GpuError> {
    let parameters = &state.scene.parameters;
    let count = state.source_count() as u32;
    let mut used = record_source_uses(tools, state)?;
    if let Some(recycling) = limits.recycling {
        recycling.retire(tools, state, &used.uses, &used.felt, &mut used.highest_logits)?;
    }
    for window in state.scene.windows.iter() {
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
            uses: &used.uses,
            highest_logits: &used.highest_logits,
            log_world_scales: &used.log_world_scales,
            own_counts: &needs.own_counts,
            own_gradients: &needs.own_gradients,
            keys: &mut sort.keys,
            values: &mut sort.values,
            counts: &mut fates.counts,
            gains: &mut gains.gains,
            growths: &mut fates.growths,
            kept_expanded: &mut gains.kept_expanded,
            gains_expanded: &mut gains.gains_expanded,
        };
        let first = window.shown.first;
        debug_assert!(window.bands_begin_alike(state.scene.sh_degree), "all Gaussians have the same SH bands");
        let count = window.shown.count.min(count - first);
        let params = densify_mark::Params { first, count, ..limits.mark };
        let (grid, parts) = (tools.threads(count), state.scene.parts(&window));
        tools.recorder.dispatch_parts(&tools.pipelines.densify_mark, grid, &params, bindings, &parts)?;
    }
    Ok(())
}

/// Index afterwards of the first Gaussian that comes from each boundary of the layout or from a later Gaussian.
fn moved_boundaries(
    tools: &Tools,
    state: &DeviceState,
    fates: &Fates,
    after: u32,
) -> Result<BTreeMap<u32, u32>, GpuError> {
    let end = state.source_count();
    let boundaries = state.layout.boundaries();
    let inner: Vec<usize> = boundaries.iter().map(|&i| i as usize).filter(|&i| i < end).collect();
    let moved = download_elements(&tools.gpu, &fates.firsts, &inner)?;
    Ok(boundaries.into_iter().zip(moved.into_iter().chain([after])).collect())
}

/// The origins of the offset records in the layout `after`, to which `runs` move.
fn place_offsets(
    tools: &mut Tools,
    state: &DeviceState,
    moves: &Moves,
    after: &SourceLayout,
    runs: &[MovedRun],
) -> Result<Moves, GpuError> {
    let mut out = Moves::new(&tools.gpu, after.offsets as u32)?;
    for run in runs {
        let [before, now] = [&state.layout, after].map(|layout| layout.template_ranges[run.template as usize]);
        let bindings = densify_place_offsets::Bindings {
            origins: &moves.origins,
            made: &moves.made,
            offset_origins: &mut out.origins,
            offset_made: &mut out.made,
        };
        let params = densify_place_offsets::Params {
            count: now.count,
            first_source: now.first,
            first_source_before: before.first,
            first_offset: run.after,
            first_offset_before: run.before,
        };
        let grid = tools.threads(now.count);
        tools.recorder.dispatch(&tools.pipelines.densify_place_offsets, grid, &params, bindings)?;
    }
    tools.run()?;
    Ok(out)
}

/// Lists the new Gaussians, `after` in all, with their origins; those that instances get for their own are still to come.
fn place(
    tools: &mut Tools,
    state: &DeviceState,
    fates: &Fates,
    after: u32,
    gains: &own::Gains,
) -> Result<Moves, GpuError> {
    let mut moves = Moves::new(&tools.gpu, after)?;
    for run in gains.shifted_runs(&state.layout) {
        let bindings = densify_place::Bindings {
            counts: &fates.counts,
            growths: &fates.growths,
            firsts: &fates.firsts,
            origins: &mut moves.origins,
            made: &mut moves.made,
        };
        let grid = tools.threads(run.count);
        let params = densify_place::Params { count: run.count, first_source: run.first, shift: run.shift };
        tools.recorder.dispatch(&tools.pipelines.densify_place, grid, &params, bindings)?;
    }
    tools.run()?;
    Ok(moves)
}

/// Divides the offsets of split Gaussians among their children, in every run of `runs`. Source Gaussians and offset records have
/// been moved to the layout `after`, and children still have their parent's parameters.
fn split_offsets(
    tools: &mut Tools,
    state: &mut DeviceState,
    moves: &Moves,
    after: &SourceLayout,
    runs: &[MovedRun],
    limits: &Limits,
) -> Result<(), GpuError> {
    let traits = state.scene.traits(0);
    let kinds = bits([traits.offset_log_scales, traits.offset_quats, limits.means_have_offsets]);
    let parameters = &mut state.scene.parameters;
    for run in runs {
        let range = after.template_ranges[run.template as usize];
        let bindings = densify_split_offsets::Bindings {
            origins: &moves.origins,
            made: &moves.made,
            quats: &parameters.quats,
            log_scales: &parameters.log_scales,
            opacity_logits: &parameters.opacity_logits,
            offset_log_scales: &parameters.offset_log_scales,
            offset_quats: &parameters.offset_quats,
            offset_means: &mut parameters.offset_means,
            offset_opacity_logits: &mut parameters.offset_opacity_logits,
        };
        let densify_split::Params { seed, time, halves, distance, opacity, .. } = limits.split;
        let params = densify_split_offsets::Params {
            count: range.count,
            first_source: range.first,
            first_offset: run.after,
            kinds,
            seed,
            time,
            halves,
            distance,
            opacity,
        };
        let grid = tools.threads(range.count);
        tools.recorder.dispatch(&tools.pipelines.densify_split_offsets, grid, &params, bindings)?;
    }
    tools.run()
}

fn split_children(tools: &mut Tools, state: &mut DeviceState, moves: &Moves, limits: &Limits) -> Result<(), GpuError> {
    let parameters = &mut state.scene.parameters;
    let bindings = densify_split::Bindings {
        origins: &moves.origins,
        made: &moves.made,
        quats: &parameters.quats,
        means: &mut parameters.means,
        log_scales: &mut parameters.log_scales,
        opacity_logits: &mut parameters.opacity_logits,
    };
    let params = densify_split::Params { count: moves.count, ..limits.split };
    let grid = tools.threads(moves.count);
    tools.recorder.dispatch(&tools.pipelines.densify_split, grid, &params, bindings)?;
    tools.run()
}

/// Lowers all opacities to at most `opacity`.
pub(super) fn reset_opacity(tools: &mut Tools, state: &mut DeviceState, opacity: f64) -> Result<(), GpuError> {
    let count = state.source_count() as u32;
    let bindings = reset_kernel::Bindings {
        opacity_logits: &mut state.scene.parameters.opacity_logits,
        moments: &mut state.moments.parameters[Parameter::OpacityLogits],
    };
    let grid = tools.threads(count);
    let params = reset_kernel::Params { count, logit_max: logit(opacity) };
    tools.recorder.dispatch(&tools.pipelines.reset_opacity, grid, &params, bindings)?;
    tools.run()
}

/// Lowers every opacity by `decay`.
pub(super) fn decay_opacity(tools: &mut Tools, state: &mut DeviceState, decay: f64) -> Result<(), GpuError> {
    let count = state.source_count() as u32;
    let bindings = decay_kernel::Bindings { opacity_logits: &mut state.scene.parameters.opacity_logits };
    let grid = tools.threads(count);
    let params = decay_kernel::Params { count, decay: decay as f32, opacity_floor: LOWEST_DECAYED as f32 };
    tools.recorder.dispatch(&tools.pipelines.decay_opacity, grid, &params, bindings)?;
    tools.run()
}
