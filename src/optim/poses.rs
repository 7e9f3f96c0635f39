//! Adam on the poses of instances.

use crate::gpu::interface::types;
use crate::gpu::{Buffer, GpuError, Grid, Pipeline, Recorder};
use crate::kernels::refine_poses;

use super::adam::{Adam, MomentBuffer};

/// Values of a pose step: translation (template units), rotation vector (radians) and logarithm of the scale.
pub const POSE_VALUES: usize = 7;

/// The buffers of a step on poses.
pub struct PoseBuffers<'a> {
    /// Gradients of the loss, one record per instance.
    pub gradients: &'a Buffer<types::PoseGradient>,
    /// The instance table, whose transforms the step changes.
    pub instances: &'a mut Buffer<types::Instance>,
    /// Moments of the gradients, [`POSE_VALUES`] per instance; the step changes them.
    pub moments: &'a mut MomentBuffer,
    /// Number of rows of the instances to refine, from the first one on.
    pub posed_rows: u32,
}

impl Adam {
    /// Records a step on the poses of the instances of the first rows, with the learning `rates` of translation, rotation
    /// and log scale. Records nothing if all are 0. The device skips the step if `status` holds an overflow.
    pub fn record_poses(
        &self,
        recorder: &mut Recorder,
        pipeline: &Pipeline<refine_poses::RefinePoses>,
        workgroup_size: u32,
        status: &Buffer<u32>,
        buffers: PoseBuffers<'_>,
        rates: [f64; 3],
    ) -> Result<(), GpuError> {
        let PoseBuffers { gradients, instances, moments, posed_rows } = buffers;
        if posed_rows == 0 || rates == [0.0; 3] {
            return Ok(());
        }
        let [translation_rate, rotation_rate, log_scale_rate] = rates.map(|rate| self.corrected(rate));
        let params = refine_poses::Params {
            posed_rows,
            translation_rate,
            rotation_rate,
            log_scale_rate,
            beta1: self.beta1 as f32,
            beta2: self.beta2 as f32,
            second_scale: self.second_scale(),
            epsilon: self.epsilon as f32,
        };
        let bindings = refine_poses::Bindings { pose_gradients: gradients, status, instances, pose_moments: moments };
        recorder.dispatch(pipeline, Grid::threads(posed_rows, workgroup_size), &params, bindings)
    }
}
