//! Depth slabs: a frame whose pairs of a splat and a tile exceed the buffer is listed and blended in several.

use std::sync::Arc;

use crate::gpu::interface::constants::*;
use crate::gpu::interface::types;
use crate::gpu::{Gpu, GpuError, PipelineCache};
use crate::kernels::{Purpose, Variant};

use super::super::device_scene::DeviceScene;
use super::super::error::RenderError;
use super::super::extra_passes::ExtraPasses;
use super::super::forward::{
    read_counters, record_begin, record_blend, record_end, record_lists, record_splats, record_visibility,
    write_counters,
};
use super::super::frame_buffers::FrameBuffers;
use super::super::frame_stats::FrameStats;
use super::super::layers::record_next_layer;
use super::super::plan::grown;
use super::super::render_options::RenderOptions;
use super::{Renderer, unreachable_state};

/// Values of the counter slots, `COUNTER_*`.
pub(in crate::render) type Counters = [u32; COUNTER_COUNT as usize];

/// True if no visible splat lies behind the slab.
fn is_last(counters: &Counters) -> bool {
    counters[COUNTER_SLAB_END as usize] >= counters[COUNTER_VISIBLE as usize]
}

/// A depth slab that has just been blended (or listed only, if it is the last), for [`Renderer::list_slabs`].
pub(in crate::render) struct BlendedSlab<'a> {
    /// The device of the renderer.
    pub(in crate::render) gpu: &'a Arc<Gpu>,
    /// The cache of the renderer's pipelines.
    pub(in crate::render) cache: &'a PipelineCache,
    /// The variant of the lists, with this picture's tile size.
    pub(in crate::render) variant: Variant,
    /// Lists and splats; its `depths` hold the transmittances behind the slab if it was blended.
    pub(in crate::render) frame: &'a FrameBuffers,
    /// True for the frontmost slab.
    pub(in crate::render) first: bool,
    /// True for the rearmost slab.
    pub(in crate::render) last: bool,
}

/// Called after each depth slab of a frame that is not redone.
pub(in crate::render) type AfterSlab<'a> = dyn FnMut(BlendedSlab<'_>) -> Result<(), RenderError> + 'a;

/// What to do with the lists of each depth slab.
pub(in crate::render) enum EachSlab<'a> {
    /// Blend them onto the picture; the optional passes follow in the same command buffer.
    Blend(ExtraPasses<'a>),
    /// Call the host when they are complete. The last slab is not blended, so there is no picture.
    List(&'a mut AfterSlab<'a>),
}

impl EachSlab<'_> {
    /// True if slabs are blended and nothing else follows, so that no pass wants whole lists.
    pub(super) fn is_blend_only(&self) -> bool {
        matches!(self, Self::Blend(extra) if extra.is_empty())
    }

    /// What a picture with these options is drawn for: the host wants whole lists, as optional passes do.
    pub(super) fn purpose(&self, options: &RenderOptions) -> Purpose {
        match self {
            Self::Blend(extra) => purpose_of(extra, options),
            Self::List(_) => Purpose::Whole,
        }
    }
}

/// What a picture with these options and optional passes is drawn for.
pub(in crate::render) fn purpose_of(extra: &ExtraPasses<'_>, options: &RenderOptions) -> Purpose {
    if options.occlusion && extra.is_empty() { Purpose::Layered } else { Purpose::Whole }
}

/// Where a submission of a frame begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Start {
    /// With the test of instances.
    Frame,
    /// With the next depth layer.
    Layer,
    /// With the chunks of a depth range that have been found.
    Chunks,
    /// With the next depth slab.
    Slab,
}

impl Renderer {
    /// Draws a slab, starting from `counters`; the first of a frame or layer includes culling. Returns the counters after it.
    pub(super) fn submit_slab(
        &mut self,
        scene: &DeviceScene,
        view: types::View,
        options: &RenderOptions,
        each: &mut EachSlab<'_>,
        counters: Counters,
        start: Start,
    ) -> Result<Counters, RenderError> {
        let pipelines = self.pipelines.of(each.purpose(options));
        let (Some(pipelines), Some(frame)) = (pipelines, &mut self.frame) else { unreachable_state() };
        let inputs = Self::inputs(pipelines, &self.primitives, &self.gpu, scene, view, options);
        let recorder = &mut self.recorder;
        write_counters(&mut frame.counters_start, &counters);
        record_begin(recorder, frame)?;
        match (start, &pipelines.layers) {
            (Start::Frame, _) => record_visibility(recorder, &inputs, frame)?,
            (Start::Layer, Some(layers)) => record_next_layer(recorder, layers, &inputs, frame)?,
            (Start::Chunks, _) => record_splats(recorder, &inputs, frame)?,
            (Start::Layer, None) | (Start::Slab, _) => {}
        }
        record_lists(recorder, &inputs, frame)?;
        if let EachSlab::Blend(extra) = each {
            record_blend(recorder, &inputs, frame)?;
            extra.record(recorder, &inputs, frame)?;
        }
        record_end(recorder, frame)?;
        let ticket = recorder.submit()?;
        scene.changes_submitted();
        recorder.wait(ticket)?;
        let counters = read_counters(frame);
        if matches!(each, EachSlab::List(_)) && !is_last(&counters) {
            record_blend(recorder, &inputs, frame)?;
            let ticket = recorder.submit()?;
            recorder.wait(ticket)?;
        }
        Ok(counters)
    }

    /// Calls the host after a slab, if it asked for that.
    pub(super) fn slab_done(
        &self,
        each: &mut EachSlab<'_>,
        first: bool,
        counters: &Counters,
    ) -> Result<(), RenderError> {
        let EachSlab::List(after_slab) = each else { return Ok(()) };
        let (Some(pipelines), Some(frame)) = (&self.pipelines.whole, &self.frame) else { unreachable_state() };
        let (variant, last) = (pipelines.variant, is_last(counters));
        after_slab(BlendedSlab { gpu: &self.gpu, cache: &self.cache, variant, frame, first, last })
    }

    /// Blends the remaining slabs of a frame or layer, and enlarges the intersection buffer for the next frame. Returns the
    /// counters after the last.
    pub(super) fn finish_slabs(
        &mut self,
        scene: &DeviceScene,
        view: types::View,
        options: &RenderOptions,
        each: &mut EachSlab<'_>,
        mut counters: Counters,
        stats: &mut FrameStats,
    ) -> Result<Counters, RenderError> {
        let needed = counters[COUNTER_INTERSECTIONS as usize];
        stats.slabs += 1;
        stats.work_items += u64::from(counters[COUNTER_WORK_ITEMS as usize]);
        stats.visible += u64::from(counters[COUNTER_VISIBLE as usize]);
        stats.intersections += u64::from(counters[COUNTER_SLAB_INTERSECTIONS as usize]);
        while !is_last(&counters) {
            let begin = counters[COUNTER_SLAB_END as usize];
            counters[COUNTER_SLAB_BEGIN as usize] = begin;
            counters = self.submit_slab(scene, view, options, each, counters, Start::Slab)?;
            if counters[COUNTER_SLAB_END as usize] <= begin {
                let reason = format!("made no progress at splat {begin}");
                return Err(GpuError::Kernel { kernel: "plan_slab".into(), reason }.into());
            }
            stats.slabs += 1;
            stats.intersections += u64::from(counters[COUNTER_SLAB_INTERSECTIONS as usize]);
            stats.passes_ms.extend(self.recorder.passes_ms()?);
            self.slab_done(each, false, &counters)?;
        }
        let most = self.most_intersections_of_device();
        if needed > self.capacities.intersections {
            self.capacities.intersections = grown(needed, most);
        }
        Ok(counters)
    }
}
