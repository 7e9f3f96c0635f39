//! Depth layers: what frames with [`RenderOptions::occlusion`](super::RenderOptions::occlusion) record besides
//! (`glsl/include/layers.glsl`).

use crate::gpu::interface::constants::*;
use crate::gpu::{GpuError, Grid, Recorder};
use crate::kernels::pipelines::LayerPipelines;
use crate::kernels::{close_tiles, layer_histogram, next_layer, plan_layers};

use super::forward::{ForwardInputs, args, record_layer};
use super::frame_buffers::FrameBuffers;
use super::renderer::Counters;

/// Chooses the depths of the layers, after the test of instances; all tiles are open.
pub(super) fn record_layer_plan(
    recorder: &mut Recorder,
    layers: &LayerPipelines,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let scene = inputs.scene;
    recorder.fill(&mut frame.closed_runs, 0)?;
    recorder.fill(&mut frame.layer_bins, 0)?;
    let bindings = layer_histogram::Bindings {
        instances: &scene.instances,
        chunks: &scene.chunks,
        candidate_offsets: &frame.candidate_offsets,
        counters: &frame.scratch.counters,
        layer_bins: &mut frame.layer_bins,
    };
    let params = layer_histogram::Params { view: inputs.view, instance_count: scene.instance_count };
    let per_candidate = args(FAMILY_CANDIDATES, ARGS_THREADS);
    recorder.dispatch_indirect(&layers.layer_histogram, &frame.scratch.args, per_candidate, &params, bindings)?;
    let bindings = plan_layers::Bindings { layer_bins: &frame.layer_bins, counters: &mut frame.scratch.counters };
    recorder.dispatch(&layers.plan_layers, Grid::groups(1), &(), bindings)
}

/// Keeps the counts of the layer that has been recorded, for the host, which will not wait for them.
pub(super) fn record_layer_log(
    recorder: &mut Recorder,
    layers: &LayerPipelines,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let capacities = [frame.plan.capacities.candidates, frame.plan.capacities.work_items];
    let bindings = next_layer::Bindings { counters: &mut frame.scratch.counters };
    recorder.dispatch(&layers.next_layer, Grid::groups(1), &next_layer::Params { capacities }, bindings)
}

/// What a depth layer needed, at the end of a frame that was submitted as one slab a layer; the only one of whole frames, too.
#[derive(Clone, Copy, Debug)]
pub(super) struct LayerNeeds {
    /// Visible chunks.
    pub(super) work_items: u32,
    /// Splats.
    pub(super) visible: u32,
    /// (splat, tile) pairs.
    pub(super) intersections: u32,
}

impl LayerNeeds {
    /// By layer, from the front, by the frame's final counters.
    pub(super) fn of_frame(counters: &Counters) -> Vec<Self> {
        let last = counters[COUNTER_LAYER as usize] as usize;
        let logged = counters[COUNTER_LAYER_LOG as usize..].chunks_exact(LAYER_LOG_LENGTH as usize);
        let of_log = |log: &[u32]| Self {
            work_items: log[LAYER_LOG_WORK_ITEMS as usize],
            visible: log[LAYER_LOG_VISIBLE as usize],
            intersections: log[LAYER_LOG_INTERSECTIONS as usize],
        };
        let own = Self {
            work_items: counters[COUNTER_WORK_ITEMS_NEEDED as usize],
            visible: counters[COUNTER_VISIBLE as usize],
            intersections: counters[COUNTER_INTERSECTIONS as usize],
        };
        logged.take(last).map(of_log).chain([own]).collect()
    }
}

/// Closes tiles by what has been blended, then expands and sorts the next layer.
pub(super) fn record_next_layer(
    recorder: &mut Recorder,
    layers: &LayerPipelines,
    inputs: &ForwardInputs<'_>,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    record_close_tiles(recorder, layers, frame)?;
    record_layer(recorder, inputs, frame)
}

/// Closes tiles by what has been blended.
pub(super) fn record_close_tiles(
    recorder: &mut Recorder,
    layers: &LayerPipelines,
    frame: &mut FrameBuffers,
) -> Result<(), GpuError> {
    let (size_px, tiles) = (frame.plan.size_px, frame.plan.tiles);
    let bindings = close_tiles::Bindings { depths: &frame.depths, closed_runs: &mut frame.closed_runs };
    let params = close_tiles::Params { size_px, tiles };
    recorder.dispatch(&layers.close_tiles, Grid::groups(tiles[1]), &params, bindings)
}
