//! The forward pass, in order: `record_visibility`, then `record_slab`, make up the whole frame.

use crate::gpu::interface::constants::*;
use crate::gpu::interface::types;
use crate::gpu::{Buffer, GpuError, Grid, Pipeline, Recorder};
use crate::kernels::pipelines::ExpandPipeline;
use crate::kernels::*;

use super::device_scene::DeviceScene;
use super::frame_buffers::FrameBuffers;
use super::layers::record_layer_plan;
use super::plan::radix_passes;
use super::scan::{Blocks, ScanInput, plain, record_scan};
use super::sort::{Sort, record_sort};
use super::source_windows::SourceWindow;

/// Inputs of the passes of a frame besides buffers.
pub struct ForwardInputs<'a> {
    /// The scene on the device.
    pub scene: &'a DeviceScene,
    /// Compiled forward kernels.
    pub pipelines: &'a Pipelines,
    /// Compiled kernels of scan and sort.
    pub primitives: &'a Primitives,
    /// The camera as the kernels see it.
    pub view: types::View,
    /// Background colour, rgb in the encoding of the training images.
    pub background: [f32; 3],
    /// Largest cell of a level of detail that is shown, pixels; 0 = everything at full detail.
    pub lod_error_px: f32,
    /// Largest number of splats in a slab (see `DeviceCaps::loop_iteration_limit`); any in training, where a step is one slab.
    pub max_slab_splats: u32,
}

pub(super) const fn args(family: u32, kind: u32) -> usize {
    (family * ARGS_PER_COUNT + kind) as usize
}

const fn args_u32(family: u32, kind: u32) -> u32 {
    family * ARGS_PER_COUNT + kind
}

/// Records the copy of the counters that the host prepared.
pub fn record_begin(recorder: &mut Recorder, frame: &mut FrameBuffers) -> Result<(), GpuError> {
    let bytes = frame.counters_start.bytes();
    recorder.copy(&frame.counters_start, &mut frame.scratch.counters, bytes)
}

/// Records the copy of the counters to host-visible memory after the frame.
pub fn record_end(recorder: &mut Recorder, frame: &mut FrameBuffers) -> Result<(), GpuError> {
    let bytes = frame.counters_end.bytes();
    recorder.copy(&frame.scratch.counters, &mut frame.counters_end, bytes)
}

/// Records the passes from instances to chunks, splats and their order by depth: of the whole frame, or of its first depth
/// layer. Rows of the instance table that an edit changed are written first.
pub fn record_visibility(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    record_instances_of_frame(recorder, inputs, frame)?;
    record_layer(recorder, inputs, frame)
}

/// The part of [`record_visibility`] that a frame has once: changed rows, the test of instances, the depths of layers.
pub(super) fn record_instances_of_frame(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    inputs.scene.record_changes(recorder)?;
    record_instances(recorder, inputs, frame)?;
    match &inputs.pipelines.layers {
        Some(layers) => record_layer_plan(recorder, layers, inputs, frame),
        None => Ok(()),
    }
}

/// The passes of [`record_visibility`] that each depth layer has for itself.
pub(super) fn record_layer(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    record_chunks(recorder, inputs, frame)?;
    record_splats(recorder, inputs, frame)
}

/// The second part of [`record_layer`]: expands the chunks that [`record_chunks`] has found, and sorts their splats by depth.
pub(super) fn record_splats(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    record_expansion(recorder, inputs, frame)?;
    let sort = Sort { count_slot: COUNTER_VISIBLE, family: FAMILY_VISIBLE, passes: radix_passes(u32::MAX) };
    let tables = &mut frame.digit_tables;
    record_sort(recorder, inputs.primitives, &mut frame.scratch, tables, sort, &mut frame.depth_sort)
}

/// The first level of culling, and the ordered compaction that follows.
fn record_instances(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let (p, scene, view) = (inputs.pipelines, inputs.scene, inputs.view);
    let instance_count = scene.instance_count;
    let capacities = frame.plan.capacities;
    let bindings =
        cull_instances::Bindings { instances: &scene.instances, instance_chunks: &mut frame.instance_chunks };
    let grid = Grid::threads(instance_count, p.variant.workgroup_size);
    let params = cull_instances::Params { view, instance_count, lod_error_px: inputs.lod_error_px };
    recorder.dispatch(&p.cull_instances, grid, &params, bindings)?;

    let mut scan = plain(COUNTER_INSTANCES);
    scan.total_slot = COUNTER_CANDIDATES;
    scan.needed_slot = COUNTER_CANDIDATES_NEEDED;
    scan.capacity = capacities.candidates;
    scan.family = FAMILY_CANDIDATES;
    let blocks = Blocks::Direct(Grid::threads(instance_count, BLOCK_SIZE));
    let input = ScanInput::in_order(&frame.instance_chunks);
    record_scan(
        recorder,
        &inputs.primitives.scan,
        &mut frame.scratch,
        blocks,
        scan,
        input,
        &mut frame.candidate_offsets,
    )
}

/// The first part of [`record_layer`]: the second level of culling, with its compaction.
pub(super) fn record_chunks(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let (p, scene, view) = (inputs.pipelines, inputs.scene, inputs.view);
    let (instance_count, capacities) = (scene.instance_count, frame.plan.capacities);
    let bindings = cull_chunks::Bindings {
        instances: &scene.instances,
        chunks: &scene.chunks,
        candidate_offsets: &frame.candidate_offsets,
        counters: &frame.scratch.counters,
        candidate_visible: &mut frame.candidate_visible,
        candidates: &mut frame.candidates,
        closed_runs: &frame.closed_runs,
    };
    let per_candidate = args(FAMILY_CANDIDATES, ARGS_THREADS);
    recorder.dispatch_indirect(
        &p.cull_chunks,
        &frame.scratch.args,
        per_candidate,
        &cull_chunks::Params { view, instance_count },
        bindings,
    )?;

    let mut scan = plain(COUNTER_CANDIDATES);
    scan.total_slot = COUNTER_WORK_ITEMS;
    scan.needed_slot = COUNTER_WORK_ITEMS_NEEDED;
    scan.capacity = capacities.work_items;
    scan.family = FAMILY_WORK_ITEMS;
    let blocks = Blocks::Indirect(args_u32(FAMILY_CANDIDATES, ARGS_BLOCKS));
    let input = ScanInput::in_order(&frame.candidate_visible);
    record_scan(recorder, &inputs.primitives.scan, &mut frame.scratch, blocks, scan, input, &mut frame.work_offsets)?;

    let bindings = emit_work_items::Bindings {
        candidates: &frame.candidates,
        candidate_visible: &frame.candidate_visible,
        work_offsets: &frame.work_offsets,
        counters: &frame.scratch.counters,
        work_items: &mut frame.work_items,
    };
    let params = emit_work_items::Params { capacity: capacities.work_items };
    let per_candidate = args(FAMILY_CANDIDATES, ARGS_THREADS);
    recorder.dispatch_indirect(&p.emit_work_items, &frame.scratch.args, per_candidate, &params, bindings)
}

/// Adds offsets, transforms and projects the Gaussians of each work item, then compacts the survivors into a dense
/// list.
fn record_expansion(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let p = inputs.pipelines;
    for window in inputs.scene.windows.iter() {
        match &p.expand {
            ExpandPipeline::Full(pipeline) => record_full_expansion(recorder, pipeline, inputs, &window, frame)?,
            ExpandPipeline::Packed(pipeline) => record_packed_expansion(recorder, pipeline, inputs, &window, frame)?,
        }
    }
    let per_item = args(FAMILY_WORK_ITEMS, ARGS_ITEMS);

    let mut scan = plain(COUNTER_WORK_ITEMS);
    scan.total_slot = COUNTER_VISIBLE;
    scan.family = FAMILY_VISIBLE;
    let blocks = Blocks::Indirect(args_u32(FAMILY_WORK_ITEMS, ARGS_BLOCKS));
    let input = ScanInput::in_order(&frame.survivor_counts);
    record_scan(
        recorder,
        &inputs.primitives.scan,
        &mut frame.scratch,
        blocks,
        scan,
        input,
        &mut frame.survivor_offsets,
    )?;

    let bindings = compact_visible::Bindings {
        splats: &frame.splats,
        survivor_counts: &frame.survivor_counts,
        survivor_offsets: &frame.survivor_offsets,
        counters: &frame.scratch.counters,
        depth_keys: &mut frame.depth_sort.keys,
        slots: &mut frame.depth_sort.values,
    };
    recorder.dispatch_indirect(&p.compact_visible, &frame.scratch.args, per_item, &(), bindings)
}

/// The expansion of a window of a scene in f32.
fn record_full_expansion(
    recorder: &mut Recorder,
    pipeline: &Pipeline<preprocess_instance_expand::PreprocessInstanceExpand>,
    inputs: &ForwardInputs<'_>,
    window: &SourceWindow,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let scene = inputs.scene;
    let parameters = &scene.parameters;
    let bindings = preprocess_instance_expand::Bindings {
        instances: &scene.instances,
        work_items: &frame.work_items,
        counters: &frame.scratch.counters,
        means: &parameters.means,
        quats: &parameters.quats,
        log_scales: &parameters.log_scales,
        opacity_logits: &parameters.opacity_logits,
        sh0: &parameters.sh0,
        sh1: &parameters.sh1,
        sh2: &parameters.sh2,
        sh3: &parameters.sh3,
        offset_means: &parameters.offset_means,
        offset_sh_dc: &parameters.offset_sh_dc,
        offset_opacity_logits: &parameters.offset_opacity_logits,
        offset_sh_rest: &parameters.offset_sh_rest,
        offset_log_scales: &parameters.offset_log_scales,
        offset_quats: &parameters.offset_quats,
        color_from_template: &parameters.color_from_template,
        splats: &mut frame.splats,
        footprints: &mut frame.footprints,
        tile_counts: &mut frame.tile_counts,
        survivor_counts: &mut frame.survivor_counts,
        closed_runs: &frame.closed_runs,
    };
    let params = preprocess_instance_expand::Params {
        view: inputs.view,
        lod_error_px: inputs.lod_error_px,
        window: window.shown,
    };
    let per_item = args(FAMILY_WORK_ITEMS, ARGS_ITEMS);
    let parts = scene.parts(window);
    recorder.dispatch_indirect_parts(pipeline, &frame.scratch.args, per_item, &params, bindings, &parts)
}

/// The expansion of a window of a packed scene.
fn record_packed_expansion(
    recorder: &mut Recorder,
    pipeline: &Pipeline<preprocess_instance_expand_packed::PreprocessInstanceExpandPacked>,
    inputs: &ForwardInputs<'_>,
    window: &SourceWindow,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let scene = inputs.scene;
    let packed = &scene.packed;
    let [sh0, sh1, sh2, sh3] = &packed.sh;
    let [packed_offset_means, offset_sh_dc, offset_log_scales, offset_quats] = &packed.offsets;
    let bindings = preprocess_instance_expand_packed::Bindings {
        instances: &scene.instances,
        work_items: &frame.work_items,
        counters: &frame.scratch.counters,
        means: &scene.parameters.means,
        shapes: &packed.shapes,
        quats: &packed.quats,
        sh0,
        sh1,
        sh2,
        sh3,
        packed_offset_means,
        offset_sh_dc,
        offset_log_scales,
        offset_quats,
        offset_sh_rest: &packed.offset_sh_rest,
        offset_ranges: &packed.offset_ranges,
        color_from_template: &scene.parameters.color_from_template,
        splats: &mut frame.splats,
        footprints: &mut frame.footprints,
        tile_counts: &mut frame.tile_counts,
        survivor_counts: &mut frame.survivor_counts,
        closed_runs: &frame.closed_runs,
    };
    let params = preprocess_instance_expand_packed::Params {
        view: inputs.view,
        lod_error_px: inputs.lod_error_px,
        window: window.shown,
    };
    let per_item = args(FAMILY_WORK_ITEMS, ARGS_ITEMS);
    let parts = scene.parts(window);
    recorder.dispatch_indirect_parts(pipeline, &frame.scratch.args, per_item, &params, bindings, &parts)
}

/// One depth slab: the next run of splats whose intersections fit, sorted by tile and blended onto the picture.
pub fn record_slab(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    record_lists(recorder, inputs, frame)?;
    record_blend(recorder, inputs, frame)
}

/// The first part of [`record_slab`]: the splats of each tile, front to back.
pub(super) fn record_lists(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let p = inputs.pipelines;
    let plan = frame.plan;
    let mut scan = plain(COUNTER_VISIBLE);
    scan.begin_slot = COUNTER_SLAB_BEGIN;
    scan.needed_slot = COUNTER_INTERSECTIONS;
    let blocks = Blocks::Indirect(args_u32(FAMILY_VISIBLE, ARGS_BLOCKS));
    let input = ScanInput { values: &frame.tile_counts, indices: Some(&frame.depth_sort.values) };
    record_scan(recorder, &inputs.primitives.scan, &mut frame.scratch, blocks, scan, input, &mut frame.isect_offsets)?;

    let scratch = &mut frame.scratch;
    let bindings = plan_slab::Bindings {
        isect_offsets: &frame.isect_offsets,
        counters: &mut scratch.counters,
        args: &mut scratch.args,
    };
    let params = plan_slab::Params { capacity: plan.capacities.intersections, max_splats: inputs.max_slab_splats };
    recorder.dispatch(&p.plan_slab, Grid::groups(1), &params, bindings)?;

    let bindings = emit_intersections::Bindings {
        footprints: &frame.footprints,
        slot_from_order: &frame.depth_sort.values,
        isect_offsets: &frame.isect_offsets,
        tile_counts: &frame.tile_counts,
        counters: &frame.scratch.counters,
        tile_keys: &mut frame.tile_sort.keys,
        isect_values: &mut frame.tile_sort.values,
        slot_from_emission: &mut frame.slot_from_emission,
        emission_ranges: &mut frame.emission_ranges,
        closed_runs: &frame.closed_runs,
    };
    let params = emit_intersections::Params { tiles: plan.tiles, capacity: plan.capacities.intersections };
    let per_splat = args(FAMILY_SLAB_SPLATS, ARGS_THREADS);
    recorder.dispatch_indirect(&p.emit_intersections, &frame.scratch.args, per_splat, &params, bindings)?;

    let sort =
        Sort { count_slot: COUNTER_SLAB_INTERSECTIONS, family: FAMILY_INTERSECTIONS, passes: plan.tile_sort_passes() };
    let tables = &mut frame.digit_tables;
    record_sort(recorder, inputs.primitives, &mut frame.scratch, tables, sort, &mut frame.tile_sort)?;

    recorder.fill(&mut frame.tile_ranges, 0)?;
    let bindings = tile_ranges::Bindings {
        tile_keys: &frame.tile_sort.keys,
        counters: &frame.scratch.counters,
        tile_ranges: &mut frame.tile_ranges,
    };
    let per_isect = args(FAMILY_INTERSECTIONS, ARGS_THREADS);
    let params = tile_ranges::Params { tile_count: plan.tile_count() };
    recorder.dispatch_indirect(&p.tile_ranges, &frame.scratch.args, per_isect, &params, bindings)
}

/// The second part of [`record_slab`]: blends the lists.
pub(super) fn record_blend(
    recorder: &mut Recorder,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let p = inputs.pipelines;
    let plan = frame.plan;
    let bindings = tile_blend::Bindings {
        splats: &frame.splats,
        isect_values: &frame.tile_sort.values,
        slot_from_emission: &frame.slot_from_emission,
        tile_ranges: &frame.tile_ranges,
        counters: &frame.scratch.counters,
        colors: &mut frame.colors,
        depths: &mut frame.depths,
    };
    let params = tile_blend::Params { background: inputs.background, size_px: plan.size_px, tiles: plan.tiles };
    let subgroups_per_group = p.variant.blend_workgroup_size / p.variant.subgroup_size;
    let grid = Grid::groups((plan.tile_count() * p.variant.blocks_per_tile()).div_ceil(subgroups_per_group));
    recorder.dispatch(&p.tile_blend, grid, &params, bindings)
}

/// Reads the counters of a finished frame.
pub fn read_counters(frame: &FrameBuffers) -> [u32; COUNTER_COUNT as usize] {
    counters_of(&frame.counters_end)
}

/// The counters in a host-visible buffer.
pub fn counters_of(buffer: &Buffer<u32>) -> [u32; COUNTER_COUNT as usize] {
    let mut out = [0; COUNTER_COUNT as usize];
    if let Some(bytes) = buffer.mapped() {
        for (value, word) in out.iter_mut().zip(bytes.chunks_exact(4)) {
            *value = bytemuck::pod_read_unaligned(word);
        }
    }
    out
}

/// Writes the counters that the next submission starts from.
pub fn write_counters(buffer: &mut Buffer<u32>, counters: &[u32; COUNTER_COUNT as usize]) {
    if let Some(bytes) = buffer.mapped_mut() {
        bytes.copy_from_slice(bytemuck::cast_slice(counters));
    }
}
