//! Adam (Kingma and Ba 2015, algorithm 1), applied to one buffer at a time.

use std::sync::Arc;

use crate::gpu::interface::constants::STATUS_COUNT;
use crate::gpu::{Buffer, Gpu, GpuError, Grid, Home, Pipeline, Recorder, bound_runs};
use crate::kernels::adam;

/// First and second moment of every value of a parameter buffer.
pub type MomentBuffer = Buffer<[f32; 2]>;

/// Zero moments for a buffer of `values` f32.
pub fn zero_moments(gpu: &Arc<Gpu>, name: &str, values: usize) -> Result<MomentBuffer, GpuError> {
    let mut moments = Buffer::in_parts(gpu, name, values, Home::Device)?;
    let mut recorder = Recorder::new(gpu)?;
    recorder.fill(&mut moments, 0)?;
    let ticket = recorder.submit()?;
    recorder.wait(ticket)?;
    Ok(moments)
}

/// Hyperparameters and number of a step, shared by all buffers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the square root of the second moment.
    pub epsilon: f64,
    /// Number of the step, from 1: bias corrections are `1 - beta^step`.
    pub step: u64,
}

/// Two consecutive groups of values of a buffer, each with its learning rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueGroups {
    /// Number of values in each group.
    pub counts: [usize; 2],
    /// Learning rate of each group, in units of the parameters.
    pub rates: [f64; 2],
}

/// The buffers of a step, with one element per value.
pub struct AdamBuffers<'a> {
    /// Gradients of the loss.
    pub gradients: &'a Buffer<f32>,
    /// The values that the step changes.
    pub parameters: &'a mut Buffer<f32>,
    /// Moments of the gradients; the step changes them.
    pub moments: &'a mut MomentBuffer,
}

impl ValueGroups {
    /// One group of `count` values.
    pub fn single(count: usize, rate: f64) -> Self {
        Self { counts: [count, 0], rates: [rate, 0.0] }
    }

    /// True if no group has both values and a rate.
    fn are_held(&self) -> bool {
        (0..2).all(|group| self.counts[group] == 0 || self.rates[group] == 0.0)
    }
}

impl Adam {
    /// Learning rate divided by the bias correction of the first moment.
    pub(super) fn corrected(&self, rate: f64) -> f32 {
        (rate / (1.0 - self.beta1.powf(self.step as f64))) as f32
    }

    /// Reciprocal of the bias correction of the second moment.
    pub(super) fn second_scale(&self) -> f32 {
        (1.0 / (1.0 - self.beta2.powf(self.step as f64))) as f32
    }

    /// Records a step on the first values of a buffer. Records nothing, and leaves the moments alone, if no group has
    /// both values and a rate. The device skips the step if `status` holds an overflow.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        pipeline: &Pipeline<adam::Adam>,
        workgroup_size: u32,
        status: &Buffer<u32>,
        buffers: AdamBuffers<'_>,
        groups: ValueGroups,
    ) -> Result<(), GpuError> {
        debug_assert!(status.len() >= STATUS_COUNT as usize);
        if groups.are_held() {
            return Ok(());
        }
        let [split, rest] = groups.counts;
        let count = split + rest;
        let AdamBuffers { gradients, parameters, moments } = buffers;
        // Arrays that are larger than a binding take several dispatches.
        for run in bound_runs(recorder.gpu(), count, size_of::<[f32; 2]>() as u64) {
            let params = adam::Params {
                count: run.len() as u32,
                split: (split.clamp(run.start, run.end) - run.start) as u32,
                rates: groups.rates.map(|rate| self.corrected(rate)),
                beta1: self.beta1 as f32,
                beta2: self.beta2 as f32,
                second_scale: self.second_scale(),
                epsilon: self.epsilon as f32,
            };
            // Values are stepped by four: the last ones may reach into the padding.
            let end = run.end.next_multiple_of(4);
            let bytes = |value_bytes: usize| ((run.start * value_bytes) as u64, (end * value_bytes) as u64);
            let ((first, end), (first_moment, end_moment)) = (bytes(4), bytes(8));
            let parts =
                [gradients.part(first, end), parameters.part(first, end), moments.part(first_moment, end_moment)];
            let bindings = adam::Bindings {
                gradients: gradients.quads(),
                status,
                parameters: parameters.quads_mut(),
                moments: moments.quads_mut(),
            };
            let grid = Grid::threads(run.len().div_ceil(4) as u32, workgroup_size);
            recorder.dispatch_parts(pipeline, grid, &params, bindings, &parts)?;
        }
        Ok(())
    }
}
