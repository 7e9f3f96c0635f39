//! A scene in training: parameters, gradients, moments and tables on the device.

use std::sync::Arc;

use instgs_vk::gpu::{DeviceCaps, Gpu, GpuError, Recorder};
use instgs_vk::kernels::BackwardPipelines;
use instgs_vk::optim::{AdamBuffers, Exposures, MomentBuffer, POSE_VALUES, PoseBuffers, ValueGroups, zero_moments};
use instgs_vk::render::train_frame::LARGEST_OF_SLOT;
use instgs_vk::render::{DeviceScene, GradientBuffers, ParameterBuffers, RenderError, SourceTables, StepLog};
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::instanced_scene::SceneError;
use instgs_vk::scene::{Gaussians, InstancedScene, Owner, Parameter, ParameterSet, SourceLayout};

use super::config::{GaussianRates, Rates};
use super::step_runner::StepPlan;

/// Adam's moments of every parameter that training changes.
pub struct Moments {
    /// Moments of the parameter buffers of a [`DeviceScene`].
    pub parameters: ParameterSet<MomentBuffer>,
    /// Moments of the poses of instances: translation, rotation vector, logarithm of the scale.
    pub poses: MomentBuffer,
}

impl Moments {
    /// Moments of zero for a scene.
    pub fn new(gpu: &Arc<Gpu>, scene: &DeviceScene) -> Result<Self, GpuError> {
        let buffers = scene.parameters.scalars();
        let of = |p: Parameter| zero_moments(gpu, &format!("moments, {}", p.name()), buffers[p].len());
        Ok(Self {
            parameters: ParameterSet::try_from_fn(of)?,
            poses: zero_moments(gpu, "moments, poses", POSE_VALUES * scene.posed_instances() as usize)?,
        })
    }

    /// Buffers of one element, which free the memory of the moments until the next [`Moments::new`].
    fn none(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let none = || zero_moments(gpu, "no moments", 1);
        Ok(Self { parameters: ParameterSet::try_from_fn(|_| none())?, poses: none()? })
    }

    /// Bytes of all buffers.
    pub fn bytes(&self) -> u64 {
        self.parameters.iter().map(|(_, buffer)| buffer.bytes()).sum::<u64>() + self.poses.bytes()
    }
}

/// Everything on the device that changes from step to step.
pub struct DeviceState {
    /// Parameters. Chunk bounds cull nothing, as the centres move.
    pub scene: DeviceScene,
    /// Tables that map instances to their templates.
    pub tables: SourceTables,
    /// Gradients of the last step, and densification statistics.
    pub gradients: GradientBuffers,
    /// Adam's moments of all parameters.
    pub moments: Moments,
    /// Exposures of the training photos, if they are learned.
    pub exposures: Option<Exposures>,
    /// Number of steps that were done when the statistics were last zero; `None` = those of the densification before, at which every
    /// scene densified: what checkpoints of older versions mean.
    pub statistics_since: Option<u64>,
    /// How the source Gaussians and offset records are divided.
    pub layout: SourceLayout,
    /// What the device does not hold, such as the names of groups; without Gaussians and offsets.
    names: InstancedScene,
}

/// The largest number of Gaussians of SH degree `sh_degree` that can be trained on a device. The arrays of a frame, which have
/// a slot for every thread of every work-group, are bound whole; parameters, gradients and moments in parts, but an array is one
/// buffer. The largest are Adam's moments, 8 bytes for each f32 of the quaternions or the highest SH band.
pub fn most_in_training(caps: &DeviceCaps, sh_degree: u32) -> u32 {
    let moments = 8 * u64::from(4.max(3 * (2 * sh_degree + 1)));
    let most = (caps.max_storage_bytes / LARGEST_OF_SLOT).min(caps.max_buffer_bytes / moments);
    // No work-group has more than 1024 invocations.
    (most - most % 1024).min(u64::from(u32::MAX)) as u32
}

/// Refuses Gaussians that several templates would write the gradients of at once.
fn check_templates(scene: &InstancedScene) -> Result<(), SceneError> {
    let Some(t) = (0..scene.template_ranges.len()).find(|&t| scene.shares_gaussians(t)) else { return Ok(()) };
    let reason = format!("template {t} shares Gaussians with another, and training wants them apart");
    Err(SceneError { tensor: "template.ranges".into(), reason })
}

impl DeviceState {
    /// Uploads a scene, with moments of zero. Own Gaussians that instances share are copied, so that each learns its own; gradients
    /// of offset records that they share would be those of any of them (see `InstancedScene::with_unshared_offsets`).
    ///
    /// # Errors
    /// An inconsistent scene, one whose templates share Gaussians, or one beyond the device's limits.
    pub fn new(gpu: &Arc<Gpu>, scene: &InstancedScene, chunk_size: u32) -> Result<Self, RenderError> {
        let sh_degree = scene.templates.sh_degree.max(scene.background.sh_degree);
        let limit = u64::from(most_in_training(gpu.caps(), sh_degree));
        // Shared own Gaussians count once for each instance.
        let own: u64 = scene.own_ranges.iter().map(|range| u64::from(range.count)).sum();
        let needed = (scene.templates.len() + scene.background.len()) as u64 + own;
        if needed > limit {
            return Err(RenderError::TooMany { what: "Gaussians in training", needed, limit });
        }
        check_templates(scene)?;
        let scene = &scene.with_packed_own();
        let device_scene = DeviceScene::unbounded(gpu, scene, chunk_size)?;
        let layout = SourceLayout::of(scene);
        let names = InstancedScene {
            template_ranges: scene.template_ranges.clone(),
            instances: scene.instances.clone(),
            pixel_filter: scene.pixel_filter,
            near_plane: scene.near_plane,
            groups: scene.groups.clone(),
            source: scene.source.clone(),
            foreign_tensors: scene.foreign_tensors.clone(),
            foreign_metadata: scene.foreign_metadata.clone(),
            ..InstancedScene::default()
        };
        Ok(Self {
            tables: SourceTables::new(gpu, &layout, chunk_size)?,
            gradients: GradientBuffers::new(gpu, &device_scene)?,
            moments: Moments::new(gpu, &device_scene)?,
            exposures: None,
            statistics_since: Some(0),
            layout,
            names,
            scene: device_scene,
        })
    }

    /// Number of source Gaussians: templates, instances' own, and background.
    pub fn source_count(&self) -> usize {
        self.layout.source_count()
    }

    /// Makes everything but parameters and moments fit another layout: the caller has replaced those. Gradients are
    /// undefined, and statistics zero. The device must be idle.
    ///
    /// # Errors
    /// More Gaussians than the device can hold.
    pub fn relayout(&mut self, gpu: &Arc<Gpu>, layout: SourceLayout) -> Result<(), RenderError> {
        self.scene.relayout(gpu, &layout)?;
        self.tables = SourceTables::new(gpu, &layout, self.scene.chunk_size)?;
        self.gradients = GradientBuffers::new(gpu, &self.scene)?;
        self.names.drop_parallel_tensors();
        self.layout = layout;
        Ok(())
    }

    /// The same as [`DeviceState::relayout`], and replaces parameters and moments by undefined values, to be overwritten.
    ///
    /// # Errors
    /// More Gaussians than the device can hold; then the state is lost.
    pub fn relayout_undefined(&mut self, gpu: &Arc<Gpu>, layout: SourceLayout) -> Result<(), RenderError> {
        // Free first: there need not be room for both.
        self.gradients = GradientBuffers::placeholder(gpu)?;
        self.moments = Moments::none(gpu)?;
        self.scene.parameters = ParameterBuffers::new(gpu, "", &ParameterSet::from_fn(|_| [0, 0]))?;
        self.relayout(gpu, layout)?;
        self.scene.parameters = ParameterBuffers::new(gpu, "", &self.scene.counts.rows)?;
        self.moments = Moments::new(gpu, &self.scene)?;
        Ok(())
    }

    /// The scene as it is on the device. The device must be idle.
    pub fn download(&self, gpu: &Arc<Gpu>) -> Result<InstancedScene, RenderError> {
        let mut names = self.names.clone();
        names.template_ranges.clone_from(&self.layout.template_ranges);
        names.own_ranges.clone_from(&self.layout.own_ranges);
        names.own = zeros(self.layout.own, self.layout.templates.sh_degree);
        for (instance, source) in names.instances.iter_mut().zip(&self.layout.instances) {
            instance.first_offset = source.first_offset;
        }
        self.scene.download(gpu, &names)
    }

    /// Records Adam for every parameter with a learning rate in `plan`, poses included, up to its SH degree.
    pub fn record_adam(
        &mut self,
        recorder: &mut Recorder,
        pipelines: &BackwardPipelines,
        workgroup_size: u32,
        log: &StepLog,
        plan: &StepPlan,
    ) -> Result<(), GpuError> {
        let StepPlan { rates, sh_degree, .. } = plan;
        let (scene, gradients, moments) = (&mut self.scene, &self.gradients, &mut self.moments);
        let buffers = scene.parameters.scalars_mut().zip(moments.parameters.each_mut());
        for ((parameter, values, moments), (_, by)) in buffers.zip(gradients.parameters.scalars()) {
            let Some(adam) = plan.adam_of(parameter) else { continue };
            if matches!(parameter.owner(), Owner::ShBand(l) if l > *sh_degree) {
                continue;
            }
            let groups = ValueGroups {
                counts: scene.counts.rows[parameter].map(|rows| rows * parameter.width()),
                rates: rates_of(parameter, rates),
            };
            let buffers = AdamBuffers { gradients: by, parameters: values, moments };
            adam.record(recorder, &pipelines.adam, workgroup_size, &log.status, buffers, groups)?;
        }
        let Some(adam) = plan.adam_of_instances() else { return Ok(()) };
        let posed_rows = scene.posed_rows();
        let poses = PoseBuffers {
            gradients: &gradients.poses,
            instances: &mut scene.instances,
            moments: &mut moments.poses,
            posed_rows,
        };
        adam.record_poses(recorder, &pipelines.refine_poses, workgroup_size, &log.status, poses, rates.poses.values())
    }
}

/// The learning rates of a parameter: those of templates (and instances' own) and background, or that of offsets and 0.
fn rates_of(parameter: Parameter, rates: &Rates) -> [f64; 2] {
    let sources = |of: fn(&GaussianRates) -> f64| [&rates.template, &rates.background].map(of);
    let offsets = &rates.offsets;
    match parameter {
        Parameter::Means => sources(|r| r.means),
        Parameter::Quats => sources(|r| r.quats),
        Parameter::LogScales => sources(|r| r.log_scales),
        Parameter::OpacityLogits => sources(|r| r.opacity),
        Parameter::Sh0 => sources(|r| r.sh_dc),
        Parameter::Sh1 | Parameter::Sh2 | Parameter::Sh3 => sources(|r| r.sh_rest),
        Parameter::OffsetMeans => [offsets.means, 0.0],
        Parameter::OffsetShDc => [offsets.sh_dc, 0.0],
        Parameter::OffsetOpacityLogits => [offsets.opacity, 0.0],
        Parameter::OffsetShRest => [offsets.sh_rest, 0.0],
        Parameter::OffsetLogScales => [offsets.log_scales, 0.0],
        Parameter::OffsetQuats => [offsets.quats, 0.0],
        Parameter::ColorFromTemplate => [rates.color_matrices, 0.0],
    }
}

/// A cloud of `count` Gaussians with placeholder values, to be overwritten.
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
        let device = |max_storage_bytes, max_buffer_bytes| DeviceCaps {
            max_storage_bytes,
            max_buffer_bytes,
            ..DeviceCaps::default()
        };
        // 128 MiB, the smallest binding in use, and 40 bytes of a splat; 1 GiB, the smallest buffer that Vulkan allows, and 168
        // bytes for the moments of SH band 3.
        assert_eq!(most_in_training(&device(128 << 20, 1 << 30), 3), (128 << 20) / 40 / 1024 * 1024);
        assert_eq!(most_in_training(&device(1 << 30, 1 << 30), 3), (1 << 30) / 168 / 1024 * 1024);
        assert_eq!(most_in_training(&device(1 << 30, 1 << 30), 0), (1 << 30) / 40 / 1024 * 1024);
        let most = |bytes| most_in_training(&device(bytes, 1 << 30), 0);
        assert_eq!((most(40 * 2048), most(40 * 2048 - 1), most(1000)), (2048, 1024, 0), "whole work groups");
        assert_eq!(most_in_training(&device(u64::MAX, u64::MAX), 3), u32::MAX);
    }
}
