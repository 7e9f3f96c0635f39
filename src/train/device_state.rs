//! A scene in training: parameters, gradients, moments and tables on the device.

use std::sync::Arc;

use crate::gpu::{Buffer, Gpu, GpuError, Recorder};
use crate::kernels::BackwardPipelines;
use crate::optim::{Adam, MomentBuffer, zero_moments};
use crate::render::{DeviceScene, GradientBuffers, RenderError, SourceTables, StepLog};
use crate::scene::InstancedScene;

use super::config::Rates;

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
        })
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        let fixed = [&self.means, &self.quats, &self.log_scales, &self.opacity_logits];
        let offsets = [&self.offset_means, &self.offset_sh_dc, &self.offset_opacity_logits];
        fixed.into_iter().chain(&self.sh_bands).chain(offsets).map(Buffer::bytes).sum()
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
    /// Offset records.
    pub offset_count: usize,
}

impl DeviceState {
    /// Uploads a scene, with moments of zero.
    ///
    /// # Errors
    /// An inconsistent scene, or one beyond the device's limits.
    pub fn new(gpu: &Arc<Gpu>, scene: &InstancedScene, chunk_size: u32) -> Result<Self, RenderError> {
        let device_scene = DeviceScene::unbounded(gpu, scene, chunk_size)?;
        Ok(Self {
            tables: SourceTables::new(gpu, scene, chunk_size)?,
            gradients: GradientBuffers::new(gpu, &device_scene)?,
            moments: Moments::new(gpu, &device_scene)?,
            source_count: scene.templates.len() + scene.background.len(),
            offset_count: scene.offsets.len(),
            scene: device_scene,
        })
    }

    /// Records Adam on every parameter; SH bands above `sh_degree` rest.
    pub fn record_adam(
        &mut self,
        recorder: &mut Recorder,
        (pipelines, workgroup_size): (&BackwardPipelines, u32),
        log: &StepLog,
        adam: &Adam,
        rates: &Rates,
        sh_degree: u32,
    ) -> Result<(), GpuError> {
        let (scene, gradients, moments) = (&mut self.scene, &self.gradients, &mut self.moments);
        let (sources, offsets) = (self.source_count, self.offset_count);
        let mut step = |buffers: (&Buffer<f32>, &mut Buffer<f32>, &mut MomentBuffer), rate: f64, count: usize| {
            adam.record(recorder, (&pipelines.adam, workgroup_size), &log.status, buffers, rate, count)
        };
        let g = gradients;
        step((g.means.scalars(), scene.means.scalars_mut(), &mut moments.means), rates.means, 3 * sources)?;
        step((g.quats.scalars(), scene.quats.scalars_mut(), &mut moments.quats), rates.quats, 4 * sources)?;
        let log_scales = (g.log_scales.scalars(), scene.log_scales.scalars_mut(), &mut moments.log_scales);
        step(log_scales, rates.log_scales, 3 * sources)?;
        let logits = (&g.opacity_logits, &mut scene.opacity_logits, &mut moments.opacity_logits);
        step(logits, rates.opacity, sources)?;
        let bands = g.sh_bands.iter().zip(&mut scene.sh_bands).zip(&mut moments.sh_bands);
        for (l, ((gradient, band), moment)) in bands.enumerate().take(sh_degree as usize + 1) {
            let rate = if l == 0 { rates.sh_dc } else { rates.sh_rest };
            // Bands hold nothing but what clouds of their degree have; without any Gaussian, one unused element.
            let values = if sources == 0 { 0 } else { 3 * gradient.len() };
            step((gradient.scalars(), band.scalars_mut(), moment), rate, values)?;
        }
        let means = (g.offset_means.scalars(), scene.offset_means.scalars_mut(), &mut moments.offset_means);
        step(means, rates.means, 3 * offsets)?;
        let dc = (g.offset_sh_dc.scalars(), scene.offset_sh_dc.scalars_mut(), &mut moments.offset_sh_dc);
        step(dc, rates.sh_dc, 3 * offsets)?;
        let logits = (&g.offset_opacity_logits, &mut scene.offset_opacity_logits, &mut moments.offset_opacity_logits);
        step(logits, rates.opacity, offsets)
    }
}
