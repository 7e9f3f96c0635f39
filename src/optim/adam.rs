//! Adam (Kingma and Ba 2015, algorithm 1) over one buffer at a time.

use std::sync::Arc;

use crate::gpu::interface::constants::STATUS_COUNT;
use crate::gpu::staging::write;
use crate::gpu::{Buffer, Gpu, GpuError, Grid, Pipeline, Recorder};
use crate::kernels::adam;

/// First and second moment of every value of a parameter buffer.
pub type MomentBuffer = Buffer<[f32; 2]>;

/// Moments of a buffer of `values` f32 that has not been optimised yet.
pub fn zero_moments(gpu: &Arc<Gpu>, name: &str, values: usize) -> Result<MomentBuffer, GpuError> {
    let mut moments = Buffer::new(gpu, name, values)?;
    let zeros = vec![[0.0; 2]; moments.len()];
    write(gpu, &mut moments, &zeros)?;
    Ok(moments)
}

/// The numbers of one step that all buffers share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
    /// Number of the step, from 1: bias corrections are `1 - beta^step`.
    pub step: u64,
}

impl Adam {
    /// Records a step on `count` values with learning rate `rate`; nothing happens on the device if `status` holds an
    /// overflow.
    pub fn record(
        &self,
        recorder: &mut Recorder,
        (pipeline, workgroup_size): (&Pipeline<adam::Adam>, u32),
        status: &Buffer<u32>,
        (gradients, parameters, moments): (&Buffer<f32>, &mut Buffer<f32>, &mut MomentBuffer),
        rate: f64,
        count: usize,
    ) -> Result<(), GpuError> {
        debug_assert!(status.len() >= STATUS_COUNT as usize);
        if count == 0 {
            return Ok(());
        }
        let correction = |beta: f64| 1.0 - beta.powf(self.step as f64);
        let params = adam::Params {
            count: count as u32,
            rate: (rate / correction(self.beta1)) as f32,
            beta1: self.beta1 as f32,
            beta2: self.beta2 as f32,
            second_scale: (1.0 / correction(self.beta2)) as f32,
            epsilon: self.epsilon as f32,
        };
        let bindings = adam::Bindings {
            gradients: gradients.quads(),
            status,
            parameters: parameters.quads_mut(),
            moments: moments.quads_mut(),
        };
        recorder.dispatch(pipeline, Grid::threads(count.div_ceil(4) as u32, workgroup_size), &params, bindings)
    }
}
