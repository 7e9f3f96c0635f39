//! The backward pass, in order: `record_image_loss`, `record_status`, `record_gradients`.

use crate::gpu::interface::constants::*;
use crate::gpu::{Buffer, GpuError, Grid, Recorder};
use crate::kernels::*;
use crate::scene::{Owner, Parameter};

use super::forward::ForwardInputs;
use super::frame_buffers::FrameBuffers;
use super::gradients::{BackwardBuffers, GradientBuffers, SourceTables, StepLog, column_strips, row_strips};
use super::source_windows::SourceWindow;

/// Inputs of the backward passes besides buffers.
pub struct BackwardInputs<'a> {
    /// Inputs of the forward passes of the same view.
    pub forward: &'a ForwardInputs<'a>,
    /// Compiled backward kernels.
    pub pipelines: &'a BackwardPipelines,
    /// For each chunk of source Gaussians, the instances that show it.
    pub tables: &'a SourceTables,
    /// What is computed.
    pub wanted: WantedGradients,
}

/// Gradients that a step may do without.
#[derive(Clone, Copy, Debug)]
pub struct WantedGradients {
    /// Those by offsets of SH coefficients above 0; if not, their buffer stays as it is.
    pub sh_offsets: bool,
    /// Those by poses and colour matrices, of which an instance has one each; if not, their buffers stay as they are.
    pub instances: bool,
}

impl WantedGradients {
    /// Everything.
    pub const ALL: Self = Self { sh_offsets: true, instances: true };

    fn has(self, parameter: Parameter) -> bool {
        self.sh_offsets || parameter != Parameter::OffsetShRest
    }
}

/// The photo of the view, and the weights of the loss.
#[derive(Clone, Copy)]
pub struct LossInputs<'a> {
    /// The photo, by pixel: RGBA of 8 bits each (see `image_loss_rows`).
    pub targets: &'a Buffer<u32>,
    /// Weight of 1 - SSIM in the loss, 0 to 1; the mean absolute error has the rest.
    pub lambda_dssim: f32,
    /// The picture as the photo's exposure shows it, if photos have exposures; then the gradient is by its colours.
    pub exposed: Option<&'a Buffer<[f32; 4]>>,
}

/// Records the loss against the photo, and its gradient with respect to the picture.
pub fn record_image_loss(
    recorder: &mut Recorder,
    forward: &ForwardInputs<'_>,
    p: &BackwardPipelines,
    frame: &FrameBuffers,
    buffers: &mut BackwardBuffers,
    loss: LossInputs<'_>,
) -> Result<(), GpuError> {
    let LossInputs { targets, lambda_dssim, exposed } = loss;
    let colors = exposed.unwrap_or(&frame.colors);
    let (background, size_px) = (forward.background, frame.plan.size_px);
    let group = forward.pipelines.variant.workgroup_size;
    let (rows, columns) = (Grid::threads(row_strips(size_px), group), Grid::threads(column_strips(size_px), group));
    let params = image_loss_rows::Params { background, size_px };
    let bindings = image_loss_rows::Bindings { colors, targets, row_moments: &mut buffers.row_moments };
    recorder.dispatch(&p.image_loss_rows, rows, &params, bindings)?;

    let params = image_loss_columns::Params { size_px };
    let bindings = image_loss_columns::Bindings {
        row_moments: &buffers.row_moments,
        ssim_gradients: &mut buffers.ssim_gradients,
        ssim_sums: &mut buffers.ssim_sums,
    };
    recorder.dispatch(&p.image_loss_columns, columns, &params, bindings)?;

    let params = image_loss_backward_rows::Params { size_px };
    let bindings = image_loss_backward_rows::Bindings {
        ssim_gradients: &buffers.ssim_gradients,
        row_gradients: &mut buffers.row_gradients,
    };
    recorder.dispatch(&p.image_loss_backward_rows, rows, &params, bindings)?;

    let params = image_loss_backward_columns::Params { background, size_px, lambda_dssim };
    let bindings = image_loss_backward_columns::Bindings {
        row_gradients: &buffers.row_gradients,
        colors,
        targets,
        cotangents: &mut buffers.cotangents,
        error_sums: &mut buffers.error_sums,
    };
    recorder.dispatch(&p.image_loss_backward_columns, columns, &params, bindings)
}

/// What [`record_status`] has to know of a step.
#[derive(Clone, Copy, Debug)]
pub struct StepStatus {
    /// The step's number, low 32 bits.
    pub step: u32,
    /// Splats of a tile that the device's loops have iterations for; `u32::MAX` = any number.
    pub longest_list: u32,
}

/// Raises the overflow flag if the frame did not fit its buffers, and writes the record of the step.
pub fn record_status(
    recorder: &mut Recorder,
    pipelines: &BackwardPipelines,
    frame: &FrameBuffers,
    buffers: &BackwardBuffers,
    log: &mut StepLog,
    StepStatus { step, longest_list }: StepStatus,
) -> Result<(), GpuError> {
    let plan = &frame.plan;
    let params = train_status::Params {
        step,
        candidate_capacity: plan.capacities.candidates,
        work_item_capacity: plan.capacities.work_items,
        strips: column_strips(plan.size_px),
        values: 3.0 * plan.pixels() as f32,
        tile_count: if longest_list == u32::MAX { 0 } else { plan.tile_count() },
        longest_list,
    };
    let bindings = train_status::Bindings {
        counters: &frame.scratch.counters,
        ssim_sums: &buffers.ssim_sums,
        error_sums: &buffers.error_sums,
        tile_ranges: &frame.tile_ranges,
        status: &mut log.status,
        step_records: &mut log.records,
    };
    recorder.dispatch(&pipelines.train_status, Grid::groups(1), &params, bindings)
}

/// Records the passes from gradients by pixel (cotangents) to gradients by parameter.
pub fn record_gradients(
    recorder: &mut Recorder,
    inputs: &BackwardInputs<'_>,
    frame: &FrameBuffers,
    buffers: &mut BackwardBuffers,
    log: &StepLog,
    gradients: &mut GradientBuffers,
) -> Result<(), GpuError> {
    record_blend_backward(recorder, inputs, frame, buffers)?;
    // Gaussians that are not drawn have zero gradients.
    recorder.fill(&mut buffers.shape_gradients, 0)?;
    recorder.fill(&mut buffers.look_gradients, 0)?;
    if inputs.wanted.instances && inputs.pipelines.gather_color_gradients.is_some() {
        recorder.fill(&mut buffers.color_terms, 0)?;
    }
    let offsets = gradients.parameters.scalars_mut().into_iter().filter(|(p, _)| p.owner() == Owner::Offset);
    for (_, buffer) in offsets.filter(|(p, _)| inputs.wanted.has(*p)) {
        recorder.fill(buffer, 0)?;
    }
    for window in inputs.forward.scene.windows.iter() {
        record_expand_backward(recorder, inputs, frame, buffers, gradients, &window)?;
    }
    for window in inputs.forward.scene.windows.iter() {
        record_gather(recorder, inputs, frame, buffers, log, gradients, &window)?;
    }
    if !inputs.wanted.instances {
        return Ok(());
    }
    record_gather_colors(recorder, inputs, frame, buffers, gradients)?;
    if inputs.pipelines.poses { record_gather_poses(recorder, inputs, frame, buffers, gradients) } else { Ok(()) }
}

fn record_blend_backward(
    recorder: &mut Recorder,
    inputs: &BackwardInputs<'_>,
    frame: &FrameBuffers,
    buffers: &mut BackwardBuffers,
) -> Result<(), GpuError> {
    let variant = &inputs.forward.pipelines.variant;
    let plan = &frame.plan;
    let bindings = tile_blend_backward::Bindings {
        splats: &frame.splats,
        emission_from_isect: &frame.tile_sort.values,
        slot_from_emission: &frame.slot_from_emission,
        tile_ranges: &frame.tile_ranges,
        colors: &frame.colors,
        cotangents: &buffers.cotangents,
        isect_moments: &mut buffers.isect_moments,
    };
    let params =
        tile_blend_backward::Params { background: inputs.forward.background, size_px: plan.size_px, tiles: plan.tiles };
    let subgroups_per_group = variant.blend_workgroup_size / variant.subgroup_size;
    let grid = Grid::groups((plan.tile_count() * variant.blocks_per_tile()).div_ceil(subgroups_per_group));
    recorder.dispatch(&inputs.pipelines.tile_blend_backward, grid, &params, bindings)
}

fn record_expand_backward(
    recorder: &mut Recorder,
    inputs: &BackwardInputs<'_>,
    frame: &FrameBuffers,
    buffers: &mut BackwardBuffers,
    gradients: &mut GradientBuffers,
    window: &SourceWindow,
) -> Result<(), GpuError> {
    let scene = inputs.forward.scene;
    let (parameters, by) = (&scene.parameters, &mut gradients.parameters);
    let bindings = preprocess_instance_expand_backward::Bindings {
        instances: &scene.instances,
        work_items: &frame.work_items,
        counters: &frame.scratch.counters,
        survivor_counts: &frame.survivor_counts,
        footprints: &frame.footprints,
        splats: &frame.splats,
        emission_ranges: &frame.emission_ranges,
        isect_moments: &buffers.isect_moments,
        means: &parameters.means,
        offset_means: &parameters.offset_means,
        quats: &parameters.quats,
        log_scales: &parameters.log_scales,
        sh1: &parameters.sh1,
        sh2: &parameters.sh2,
        sh3: &parameters.sh3,
        offset_sh_rest: &parameters.offset_sh_rest,
        offset_log_scales: &parameters.offset_log_scales,
        offset_quats: &parameters.offset_quats,
        shape_gradients: &mut buffers.shape_gradients,
        look_gradients: &mut buffers.look_gradients,
        pose_sums: &mut buffers.pose_sums,
        offset_mean_gradients: &mut by.offset_means,
        offset_sh_dc_gradients: &mut by.offset_sh_dc,
        offset_logit_gradients: &mut by.offset_opacity_logits,
        offset_log_scale_gradients: &mut by.offset_log_scales,
        offset_quat_gradients: &mut by.offset_quats,
        color_from_template: &parameters.color_from_template,
        color_terms: &mut buffers.color_terms,
        sh0: &parameters.sh0,
        offset_sh_dc: &parameters.offset_sh_dc,
    };
    let params = preprocess_instance_expand_backward::Params {
        view: inputs.forward.view,
        capacity: frame.plan.capacities.intersections,
        blocks_per_tile: inputs.forward.pipelines.variant.blocks_per_tile(),
        posed_rows: scene.posed_rows(),
        window: window.shown,
    };
    let per_item = (FAMILY_WORK_ITEMS * ARGS_PER_COUNT + ARGS_ITEMS) as usize;
    let but_instances = inputs.pipelines.preprocess_instance_expand_backward_but_instances.as_ref();
    let whole = &inputs.pipelines.preprocess_instance_expand_backward;
    let pipeline = but_instances.filter(|_| !inputs.wanted.instances).unwrap_or(whole);
    recorder.dispatch_indirect_parts(pipeline, &frame.scratch.args, per_item, &params, bindings, &scene.parts(window))
}

/// Chunks that several rows may show get sums over these, the others have a kernel without.
fn record_gather(
    recorder: &mut Recorder,
    inputs: &BackwardInputs<'_>,
    frame: &FrameBuffers,
    buffers: &BackwardBuffers,
    log: &StepLog,
    gradients: &mut GradientBuffers,
    window: &SourceWindow,
) -> Result<(), GpuError> {
    let (scene, tables) = (inputs.forward.scene, inputs.tables);
    let mut parts = scene.parts(window);
    if scene.windows.are_several() {
        parts.extend(gradients.parts(window));
    }
    let but_sh_offsets = inputs.pipelines.gather_gradients_but_sh_offsets.as_ref();
    let shared = but_sh_offsets.filter(|_| !inputs.wanted.sh_offsets).unwrap_or(&inputs.pipelines.gather_gradients);
    let shown_once = tables.shared_chunks..tables.chunk_count;
    for (pipeline, chunks) in
        [(shared, 0..tables.shared_chunks), (&inputs.pipelines.gather_gradients_of_one, shown_once)]
    {
        if chunks.is_empty() {
            continue;
        }
        let by = &mut gradients.parameters;
        let bindings = gather_gradients::Bindings {
            source_chunks: &tables.chunks,
            instance_from_template: &tables.instance_from_template,
            instance_chunks: &frame.instance_chunks,
            candidate_offsets: &frame.candidate_offsets,
            candidate_visible: &frame.candidate_visible,
            work_offsets: &frame.work_offsets,
            counters: &frame.scratch.counters,
            shape_gradients: &buffers.shape_gradients,
            look_gradients: &buffers.look_gradients,
            mean_gradients: &mut by.means,
            quat_gradients: &mut by.quats,
            log_scale_gradients: &mut by.log_scales,
            opacity_logit_gradients: &mut by.opacity_logits,
            sh0_gradients: &mut by.sh0,
            sh1_gradients: &mut by.sh1,
            sh2_gradients: &mut by.sh2,
            sh3_gradients: &mut by.sh3,
            screen_statistics: &mut gradients.screen_statistics,
            record_statistics: &mut gradients.record_statistics,
            instances: &scene.instances,
            offset_sh_rest_gradients: &mut by.offset_sh_rest,
            status: &log.status,
        };
        let chunk_count = chunks.len() as u32;
        let params = gather_gradients::Params { first_chunk: chunks.start, chunk_count, window: window.shown };
        recorder.dispatch_parts(pipeline, Grid::groups(chunk_count), &params, bindings, &parts)?;
    }
    Ok(())
}

/// Gradients by colour matrices, in scenes that have them.
fn record_gather_colors(
    recorder: &mut Recorder,
    inputs: &BackwardInputs<'_>,
    frame: &FrameBuffers,
    buffers: &BackwardBuffers,
    gradients: &mut GradientBuffers,
) -> Result<(), GpuError> {
    let Some(pipeline) = &inputs.pipelines.gather_color_gradients else { return Ok(()) };
    let scene = inputs.forward.scene;
    let bindings = gather_color_gradients::Bindings {
        instance_chunks: &frame.instance_chunks,
        candidate_offsets: &frame.candidate_offsets,
        candidate_visible: &frame.candidate_visible,
        work_offsets: &frame.work_offsets,
        counters: &frame.scratch.counters,
        instances: &scene.instances,
        color_terms: &buffers.color_terms,
        color_from_template_gradients: &mut gradients.parameters.color_from_template,
    };
    let params = gather_color_gradients::Params { posed_rows: scene.posed_rows() };
    recorder.dispatch(pipeline, Grid::groups(scene.posed_rows()), &params, bindings)
}

fn record_gather_poses(
    recorder: &mut Recorder,
    inputs: &BackwardInputs<'_>,
    frame: &FrameBuffers,
    buffers: &BackwardBuffers,
    gradients: &mut GradientBuffers,
) -> Result<(), GpuError> {
    let bindings = gather_pose_gradients::Bindings {
        instance_chunks: &frame.instance_chunks,
        candidate_offsets: &frame.candidate_offsets,
        candidate_visible: &frame.candidate_visible,
        work_offsets: &frame.work_offsets,
        counters: &frame.scratch.counters,
        pose_sums: &buffers.pose_sums,
        instances: &inputs.forward.scene.instances,
        pose_gradients: &mut gradients.poses,
    };
    let posed_rows = inputs.forward.scene.posed_rows();
    let params = gather_pose_gradients::Params { posed_rows };
    recorder.dispatch(&inputs.pipelines.gather_pose_gradients, Grid::groups(posed_rows), &params, bindings)
}
