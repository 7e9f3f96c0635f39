//! What one frame in flight has for itself, and the recording of the frame with it.

use std::sync::Arc;

use crate::gpu::interface::constants::*;
use crate::gpu::{Buffer, Gpu, GpuError, Recorder};

use super::extra_passes::ExtraPasses;
use super::forward::{ForwardInputs, counters_of, record_slab, record_visibility, write_counters};
use super::frame_buffers::FrameBuffers;
use super::layers::{record_layer_log, record_next_layer};
use super::plan::Capacities;
use super::renderer::Counters;

/// Resources of one frame: its commands, and the counters that the device reads at its start and the host at its end.
pub(super) struct FrameSlot {
    pub(super) recorder: Recorder,
    counters_start: Buffer<u32>,
    counters_end: Buffer<u32>,
}

impl FrameSlot {
    /// A slot whose frames are recorded by `recorder`.
    pub(super) fn new(gpu: &Arc<Gpu>, recorder: Recorder) -> Result<Self, GpuError> {
        Ok(Self {
            recorder,
            counters_start: Buffer::for_upload(gpu, "counters start", COUNTER_COUNT as usize)?,
            counters_end: Buffer::for_readback(gpu, "counters end", COUNTER_COUNT as usize)?,
        })
    }

    /// Records a frame of one depth slab, or one a layer, and the optional passes; returns the capacities of its buffers.
    pub(super) fn record(
        &mut self,
        inputs: &ForwardInputs<'_>,
        frame: &mut FrameBuffers,
        extra: &mut ExtraPasses<'_>,
    ) -> Result<Capacities, GpuError> {
        let mut counters = [0; COUNTER_COUNT as usize];
        counters[COUNTER_INSTANCES as usize] = inputs.scene.instance_count;
        counters[COUNTER_LAST_LAYER as usize] = inputs.pipelines.purpose.last_layer();
        write_counters(&mut self.counters_start, &counters);
        let bytes = self.counters_start.bytes();
        self.recorder.copy(&self.counters_start, &mut frame.scratch.counters, bytes)?;
        record_visibility(&mut self.recorder, inputs, frame)?;
        record_slab(&mut self.recorder, inputs, frame)?;
        if let Some(layers) = &inputs.pipelines.layers {
            for _ in 1..LAYERS {
                record_layer_log(&mut self.recorder, layers, frame)?;
                record_next_layer(&mut self.recorder, layers, inputs, frame)?;
                record_slab(&mut self.recorder, inputs, frame)?;
            }
        }
        extra.record(&mut self.recorder, inputs, frame)?;
        self.recorder.copy(&frame.scratch.counters, &mut self.counters_end, bytes)?;
        Ok(frame.plan.capacities)
    }

    /// The counters at the end of the last frame, which must have finished.
    pub(super) fn counters(&self) -> Counters {
        counters_of(&self.counters_end)
    }
}
