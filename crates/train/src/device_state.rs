//! A scene in training: parameters, gradients, moments and tables on the device.

use std::sync::Arc;

use crate::gpu::interface::types::SourceGradient;
use crate::gpu::{Buffer, Gpu, GpuError, Recorder};
use crate::kernels::BackwardPipelines;
use crate::optim::{Adam, MomentBuffer, POSE_VALUES, ValueGroups, zero_moments};
use crate::render::{DeviceScene, GradientBuffers, RenderError, SourceTables, StepLog};
use crate::scene::gaussians::sh_coefficients;
use crate::scene::{Gaussians, InstancedScene};

use super::config::{Rates, SourceRates};

/// Moments of every parameter buffer of a [`DeviceScene`], per f32.
pub struct Moments {
    /// Of source means.
    pub means: MomentBuffer,
    /// Of source quaternions.
    pub quats: MomentBuffer,
    /// Of source log standard deviations.
    pub log_scales: MomentBuffer,
    /// Of source opacity logits.
    pub opacity_logits: MomentBuffer,
    /// Of SH bands 0 to 3.
    pub sh_bands: [MomentBuffer; 4],
    /// Of offset means.
    pub offset_means: MomentBuffer,
    /// Of offsets of SH coefficient 0.
    pub offset_sh_dc: MomentBuffer,
    /// Of offsets of opacity logits.
    pub offset_opacity_logits: MomentBuffer,
    /// Of offsets of SH coefficients above 0.
    pub offset_sh_rest: MomentBuffer,
    /// Of offsets of log standard deviations.
    pub offset_log_scales: MomentBuffer,
    /// Of offsets of quaternions.
    pub offset_quats: MomentBuffer,
    /// Of the places of instances: shift, rotation vector, logarithm of the scale.
    pub poses: MomentBuffer,
}

impl Moments {
    /// Zeros for a scene.
    pub fn new(gpu: &Arc<Gpu>, scene: &DeviceScene) -> Result<Self, GpuError> {
        let of = |name: &str, values: u64| zero_moments(gpu, &format!("moments, {name}"), values as usize / 4);
        let band = |l: usize| of(&format!("sh band {l}"), scene.sh_bands[l].bytes());
        Ok(Self {
            means: of("means", scene.means.bytes())?,
            quats: of("quats", scene.quats.bytes())?,
            log_scales: of("log_scales", scene.log_scales.bytes())?,
            opacity_logits: of("opacity_logits", scene.opacity_logits.bytes())?,
            sh_bands: [band(0)?, band(1)?, band(2)?, band(3)?],
            offset_means: of("offset means", scene.offset_means.bytes())?,
            offset_sh_dc: of("offset sh_dc", scene.offset_sh_dc.bytes())?,
            offset_opacity_logits: of("offset logits", scene.offset_opacity_logits.bytes())?,
            offset_sh_rest: of("offset sh_rest", scene.offset_sh_rest.bytes())?,
            offset_log_scales: of("offset log_scales", scene.offset_log_scales.bytes())?,
            offset_quats: of("offset quats", scene.offset_quats.bytes())?,
            poses: zero_moments(gpu, "moments, poses", POSE_VALUES * scene.posed_instances() as usize)?,
        })
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let fixed = [&self.means, &self.quats, &self.log_scales, &self.opacity_logits];
        let offsets = [&self.offset_means, &self.offset_sh_dc, &self.offset_opacity_logits];
        let rare = [&self.offset_sh_rest, &self.offset_log_scales, &self.offset_quats, &self.poses];
        fixed.into_iter().chain(&self.sh_bands).chain(offsets).chain(rare).map(Buffer::bytes).sum()
    }
}

/// Everything that changes from step to step.
pub struct DeviceState {
    /// Parameters. Chunk bounds hold nothing back: means move.
    pub scene: DeviceScene,
    /// The way from instances to templates.
    pub tables: SourceTables,
    /// Gradients of the last step, and densification statistics.
    pub gradients: GradientBuffers,
    /// Adam's moments.
    pub moments: Moments,
    /// Source Gaussians: templates and background.
    pub source_count: usize,
}

/// The most source Gaussians of SH degree `sh_degree` that training has room for where a binding has at most
/// `binding_bytes`. The largest arrays are Adam's moments, 8 bytes for each f32 of the quaternions or the highest SH band,
/// and the gradients before they are gathered, whole work groups of them.
pub fn most_in_training(binding_bytes: u64, sh_degree: u32) -> u32 {
    let moments = 8 * u64::from(4.max(3 * (2 * sh_degree + 1)));
    let most = binding_bytes / moments.max(size_of::<SourceGradient>() as u64);
    // No work group has more threads than 1024.
    (most - most % 1024).min(u64::from(u32::MAX)) as u32
}

impl DeviceState {
    /// Uploads a scene, with moments of zero.
    ///
    /// # Errors
    /// An inconsistent scene, or one beyond the device's limits.
    pub fn new(gpu: &Arc<Gpu>, scene: &InstancedScene, chunk_size: u32) -> Result<Self, RenderError> {
        let sh_degree = scene.templates.sh_degree.max(scene.background.sh_degree);
        let limit = u64::from(most_in_training(gpu.caps().max_storage_bytes, sh_degree));
        let needed = (scene.templates.len() + scene.background.len()) as u64;
        if needed > limit {
            return Err(RenderError::TooMany { what: "Gaussians in training", needed, limit });
        }
        let device_scene = DeviceScene::unbounded(gpu, scene, chunk_size)?;
        Ok(Self {
            tables: SourceTables::new(gpu, scene, chunk_size)?,
            gradients: GradientBuffers::new(gpu, &device_scene)?,
            moments: Moments::new(gpu, &device_scene)?,
            source_count: scene.templates.len() + scene.background.len(),
            scene: device_scene,
        })
    }

    /// The scene as it is on the device; what the device does not hold is that of `names`. The device must be idle.
    pub fn download(&self, gpu: &Arc<Gpu>, names: &InstancedScene) -> Result<InstancedScene, RenderError> {
        self.scene.download(gpu, names)
    }

    /// Records Adam on every parameter that has a rate, places of instances among them; SH bands above `sh_degree` rest.
    pub fn record_adam(
        &mut self,
        recorder: &mut Recorder,
        (pipelines, workgroup_size): (&BackwardPipelines, u32),
        log: &StepLog,
        adam: &Adam,
        rates: &Rates,
        sh_degree: u32,
    ) -> Result<(), GpuError> {
        let (scene, g, moments) = (&mut self.scene, &self.gradients, &mut self.moments);
        let counts = scene.counts;
        let mut step = |buffers: (&Buffer<f32>, &mut Buffer<f32>, &mut MomentBuffer), groups: ValueGroups| {
            adam.record(recorder, (&pipelines.adam, workgroup_size), &log.status, buffers, groups)
        };
        let sources = |width: usize, rate: fn(&SourceRates) -> f64| ValueGroups {
            counts: [counts.templates, counts.background].map(|count| width * count),
            rates: [&rates.template, &rates.background].map(rate),
        };
        let means = (g.means.scalars(), scene.means.scalars_mut(), &mut moments.means);
        step(means, sources(3, |r| r.means))?;
        step((g.quats.scalars(), scene.quats.scalars_mut(), &mut moments.quats), sources(4, |r| r.quats))?;
        let log_scales = (g.log_scales.scalars(), scene.log_scales.scalars_mut(), &mut moments.log_scales);
        step(log_scales, sources(3, |r| r.log_scales))?;
        let logits = (&g.opacity_logits, &mut scene.opacity_logits, &mut moments.opacity_logits);
        step(logits, sources(1, |r| r.opacity))?;
        let bands = g.sh_bands.iter().zip(&mut scene.sh_bands).zip(&mut moments.sh_bands);
        for (l, ((gradient, band), moment)) in bands.enumerate().take(sh_degree as usize + 1) {
            let mut groups = sources(3 * (2 * l + 1), if l == 0 { |r| r.sh_dc } else { |r| r.sh_rest });
            // A cloud of a lower degree has no place in the band.
            for (count, degree) in
                groups.counts.iter_mut().zip([counts.template_sh_degree, counts.background_sh_degree])
            {
                *count = if degree as usize >= l { *count } else { 0 };
            }
            step((gradient.scalars(), band.scalars_mut(), moment), groups)?;
        }
        let offsets = |width: usize, rate: f64| ValueGroups::single(width * counts.offsets, rate);
        let means = (g.offset_means.scalars(), scene.offset_means.scalars_mut(), &mut moments.offset_means);
        step(means, offsets(3, rates.offsets.means))?;
        let dc = (g.offset_sh_dc.scalars(), scene.offset_sh_dc.scalars_mut(), &mut moments.offset_sh_dc);
        step(dc, offsets(3, rates.offsets.sh_dc))?;
        let logits = (&g.offset_opacity_logits, &mut scene.offset_opacity_logits, &mut moments.offset_opacity_logits);
        step(logits, offsets(1, rates.offsets.opacity))?;
        let rest = (g.offset_sh_rest.scalars(), scene.offset_sh_rest.scalars_mut(), &mut moments.offset_sh_rest);
        step(rest, ValueGroups::single(3 * counts.offset_sh_rest, rates.offsets.sh_rest))?;
        let scales =
            (g.offset_log_scales.scalars(), scene.offset_log_scales.scalars_mut(), &mut moments.offset_log_scales);
        step(scales, ValueGroups::single(3 * counts.offset_log_scales, rates.offsets.log_scales))?;
        let quats = (g.offset_quats.scalars(), scene.offset_quats.scalars_mut(), &mut moments.offset_quats);
        step(quats, ValueGroups::single(4 * counts.offset_quats, rates.offsets.quats))?;
        let posed = scene.posed_instances();
        let poses = (&g.poses, &mut scene.instances, &mut moments.poses);
        adam.record_poses(
            recorder,
            (&pipelines.refine_poses, workgroup_size),
            &log.status,
            poses,
            rates.poses.values(),
            posed,
        )
    }
}

/// A cloud of `count` Gaussians of no particular shape, to be overwritten.
pub(super) fn zeros(count: usize, sh_degree: u32) -> Gaussians {
    Gaussians {
        sh_degree,
        means: vec![[0.0; 3]; count],
        quats: vec![[1.0, 0.0, 0.0, 0.0]; count],
        log_scales: vec![[0.0; 3]; count],
        opacity_logits: vec![0.0; count],
        sh: vec![[0.0; 3]; count * sh_coefficients(sh_degree)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn training_has_room_for_what_its_largest_array_takes() {
        // 128 MiB, the least of Vulkan devices in use: 168 bytes of moments of SH band 3; without SH, 72 of gradients.
        assert_eq!(most_in_training(128 << 20, 3), (128 << 20) / 168 / 1024 * 1024);
        assert_eq!(most_in_training(128 << 20, 0), (128 << 20) / 72 / 1024 * 1024);
        assert_eq!(most_in_training(72 * 2048, 0), 2048);
        assert_eq!(most_in_training(72 * 2048 - 1, 0), 1024, "whole work groups");
        assert_eq!((most_in_training(1000, 3), most_in_training(u64::MAX, 3)), (0, u32::MAX));
    }
}
