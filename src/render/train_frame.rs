//! The passes of a training step with their pipelines and buffers: forward, loss, backward. This module records; the
//! trainer submits, reads the records and decides what to do after an overflow.

use std::sync::Arc;

use crate::gpu::interface::constants::*;
use crate::gpu::interface::types;
use crate::gpu::{Gpu, PipelineCache, Recorder, user_cache_path};
use crate::kernels::{BackwardPipelines, Pipelines, Primitives, Purpose, Variant};
use crate::scene::Camera;

use super::backward::{
    BackwardInputs, LossInputs, StepStatus, WantedGradients, record_gradients, record_image_loss, record_status,
};
use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::forward::{ForwardInputs, record_begin, record_slab, record_visibility, write_counters};
use super::frame_buffers::FrameBuffers;
use super::gradients::{BackwardBuffers, GradientBuffers, SourceTables, StepLog};
use super::plan::{Capacities, FramePlan, INITIAL, grown};
use super::render_options::{RenderOptions, view_of};
use super::renderer::{check_fits, longest_list, tile_size_for};
use super::self_test::{first_sound, self_test};

/// Pipelines and buffers of training steps, for pictures up to a maximum size.
pub struct TrainFrame {
    gpu: Arc<Gpu>,
    cache: PipelineCache,
    variant: Variant,
    primitives: Primitives,
    pipelines: Option<(Pipelines, BackwardPipelines)>,
    buffers: Option<(FrameBuffers, BackwardBuffers)>,
    /// The plan that determined the buffer sizes: that of the largest picture.
    plan: Option<FramePlan>,
    intersections: u32,
}

/// A training view and its render options.
#[derive(Clone, Copy, Debug)]
pub struct TrainView<'a> {
    /// The camera of the view.
    pub camera: &'a Camera,
    /// The render options; `max_intersections` is ignored.
    pub options: RenderOptions,
}

/// What the backward passes of a step take besides the scene.
#[derive(Clone, Copy)]
pub struct GradientStep<'a> {
    /// For each chunk of source Gaussians, the instances that show it.
    pub tables: &'a SourceTables,
    /// The view that was drawn.
    pub view: &'a TrainView<'a>,
    /// The status of the step.
    pub log: &'a StepLog,
    /// What is computed.
    pub wanted: WantedGradients,
}

/// Bytes of a splat slot in the widest of the arrays that have one.
pub const LARGEST_OF_SLOT: u64 = {
    let (splat, shape) = (size_of::<types::Splat>(), size_of::<types::ShapeGradient>());
    if splat > shape { splat as u64 } else { shape as u64 }
};

impl TrainFrame {
    /// Creates a frame with the variant for a device's training or, if that fails the self-test, with another subgroup size that has
    /// as large chunks.
    ///
    /// # Errors
    /// As [`TrainFrame::new`], with all of them.
    pub fn sound(gpu: &Arc<Gpu>, preferred: Variant) -> Result<Self, RenderError> {
        let others = preferred.fallbacks(gpu.caps()).into_iter();
        let alike = others.filter(|other| other.workgroup_size == preferred.workgroup_size);
        first_sound(preferred, alike, |variant| Self::new(gpu, variant))
    }

    /// Creates a frame for a device and variant.
    ///
    /// # Errors
    /// The device fails the self-test of scan and sort with this variant.
    pub fn new(gpu: &Arc<Gpu>, variant: Variant) -> Result<Self, RenderError> {
        let cache = PipelineCache::new(gpu, user_cache_path(&gpu.caps().name).as_deref())?;
        let primitives = Primitives::new(gpu, &cache, &variant)?;
        self_test(gpu, &primitives, &variant)?;
        Ok(Self {
            gpu: gpu.clone(),
            cache,
            variant,
            primitives,
            pipelines: None,
            buffers: None,
            plan: None,
            intersections: INITIAL.intersections,
        })
    }

    /// The kernel variant; its `workgroup_size` is the chunk size of scenes.
    pub fn variant(&self) -> &Variant {
        &self.variant
    }

    /// The cache that pipelines of the same run share.
    pub fn pipeline_cache(&self) -> &PipelineCache {
        &self.cache
    }

    /// Sets the initial capacity for intersections.
    pub fn set_intersections(&mut self, intersections: u32) {
        self.intersections = intersections;
    }

    /// Makes pipelines and buffers fit the scene, SH bands up to `sh_degree`, and pictures up to `largest_px`; with
    /// `poses`, gradients by the poses of instances are included if the scene has any. If any of these has changed, no
    /// step of this frame may be in flight.
    ///
    /// # Errors
    /// A buffer exceeds the device's limits or memory; the error names it.
    pub fn prepare(
        &mut self,
        scene: &DeviceScene,
        largest_px: [u32; 2],
        sh_degree: u32,
        poses: bool,
    ) -> Result<(), RenderError> {
        let has_places = scene.posed_instances() > 0;
        let poses = poses && has_places;
        let variant = Variant { tile_size: tile_size_for(&self.gpu, &self.variant, largest_px), ..self.variant };
        let traits = scene.traits(sh_degree);
        let fits = |(forward, backward): &(Pipelines, BackwardPipelines)| {
            forward.traits == traits && forward.variant == variant && backward.poses == poses
        };
        if !self.pipelines.as_ref().is_some_and(fits) {
            let forward = Pipelines::new(&self.gpu, &self.cache, variant, traits, Purpose::Training)?;
            let backward = BackwardPipelines::new(&self.gpu, &self.cache, variant, traits, poses)?;
            self.pipelines = Some((forward, backward));
        }
        // preprocess_instance_expand_backward takes one loop iteration per 8x8 block of all tiles of a splat.
        let most = self.gpu.caps().loop_iteration_limit.map_or(u64::MAX, |most| u64::from(most - most / 16));
        let tiles = largest_px.map(|side| u64::from(side.div_ceil(variant.tile_size)));
        let blocks = tiles[0] * tiles[1] * u64::from(variant.blocks_per_tile());
        if blocks > most {
            return Err(RenderError::TooMany { what: "8x8 blocks of a training picture", needed: blocks, limit: most });
        }
        let pairs = u32::try_from(scene.chunk_pairs).unwrap_or(u32::MAX).max(1);
        // Nothing is culled by chunk, so every pair becomes a work item.
        let intersections = self.intersections.min(self.most_intersections(&variant));
        let capacities = Capacities { candidates: pairs, work_items: pairs, intersections };
        let group = variant.workgroup_size;
        let slots = u64::from(pairs) * u64::from(group);
        let most_slots = self.gpu.caps().max_storage_bytes / LARGEST_OF_SLOT;
        if slots > most_slots {
            return Err(RenderError::TooMany {
                what: "expanded Gaussians in training",
                needed: slots,
                limit: most_slots,
            });
        }
        let mut plan = FramePlan::new(largest_px, variant.tile_size, scene.instance_count, capacities, group);
        plan.training = true;
        // Pose refinement may be switched on or off while steps are in flight; the buffers must not change then.
        plan.poses = has_places;
        plan.color_matrices = traits.color_matrices;
        if self.buffers.is_none() || self.plan != Some(plan) {
            // Free the old buffers first: both sets at once may not fit.
            self.buffers = None;
            let frame = FrameBuffers::new(&self.gpu, plan)?;
            let backward = BackwardBuffers::new(&self.gpu, &plan, &variant)?;
            self.buffers = Some((frame, backward));
            self.plan = Some(plan);
            self.write_start(scene);
        }
        Ok(())
    }

    /// Writes the counters that every step starts from: all zero but the number of instances.
    fn write_start(&mut self, scene: &DeviceScene) {
        let mut counters = [0; COUNTER_COUNT as usize];
        counters[COUNTER_INSTANCES as usize] = scene.instance_count;
        if let Some((frame, _)) = &mut self.buffers {
            write_counters(&mut frame.counters_start, &counters);
        }
    }

    /// Frees the buffers; the next `prepare` makes new ones.
    pub fn release(&mut self) {
        self.buffers = None;
    }

    /// The buffers of the last step, for tests and for downloads of its picture.
    pub fn buffers(&self) -> Option<&(FrameBuffers, BackwardBuffers)> {
        self.buffers.as_ref()
    }

    /// The same as [`TrainFrame::buffers`], writable: tests write cotangents.
    pub fn buffers_mut(&mut self) -> Option<&mut (FrameBuffers, BackwardBuffers)> {
        self.buffers.as_mut()
    }

    /// Records the forward pass of a view; the picture is left in `colors`.
    pub fn record_forward(
        &mut self,
        recorder: &mut Recorder,
        scene: &DeviceScene,
        view: &TrainView<'_>,
    ) -> Result<(), RenderError> {
        let Parts { forward, frame, .. } = self.parts(scene, view);
        record_begin(recorder, frame)?;
        record_visibility(recorder, &forward, frame)?;
        record_slab(recorder, &forward, frame)?;
        Ok(())
    }

    /// Records the loss and its gradient by the picture, then the status of step `step`.
    pub fn record_loss(
        &mut self,
        recorder: &mut Recorder,
        scene: &DeviceScene,
        view: &TrainView<'_>,
        loss: LossInputs<'_>,
        log: &mut StepLog,
        step: u32,
    ) -> Result<(), RenderError> {
        let longest_list = self.longest_list();
        let Parts { forward, pipelines, frame, buffers } = self.parts(scene, view);
        record_image_loss(recorder, &forward, pipelines, frame, buffers, loss)?;
        record_status(recorder, pipelines, frame, buffers, log, StepStatus { step, longest_list })?;
        Ok(())
    }

    /// Records the backward passes from the gradient by the picture to the gradients by all parameters.
    pub fn record_gradients(
        &mut self,
        recorder: &mut Recorder,
        scene: &DeviceScene,
        step: GradientStep<'_>,
        gradients: &mut GradientBuffers,
    ) -> Result<(), RenderError> {
        let GradientStep { tables, view, log, wanted } = step;
        // gather_gradients walks over the instances of a Gaussian three times.
        let most = self.gpu.caps().loop_iteration_limit.map_or(u32::MAX, |most| (most - most / 16) / 3);
        if tables.most_instances > most {
            let (needed, limit) = (tables.most_instances.into(), most.into());
            return Err(RenderError::TooMany { what: "instances of a template in training", needed, limit });
        }
        let Parts { forward, pipelines, frame, buffers } = self.parts(scene, view);
        let inputs = BackwardInputs { forward: &forward, pipelines, tables, wanted };
        record_gradients(recorder, &inputs, frame, buffers, log, gradients)?;
        Ok(())
    }

    /// Enlarges the buffers that were too small for a step; true if the step must be redone.
    ///
    /// # Errors
    /// The view needs more than this device can hold at once.
    pub fn grow(&mut self, record: &types::StepRecord) -> Result<bool, RenderError> {
        if record.overflowed == 0 {
            return Ok(false);
        }
        let most = self.most_intersections(self.compiled_variant());
        check_fits("(splat, tile) pairs of a training view", record.intersections, most)?;
        check_fits("Gaussians on one tile of a training view", record.longest_list, self.longest_list())?;
        self.intersections = self.intersections.max(grown(record.intersections, most));
        Ok(true)
    }

    /// The largest number of (splat, tile) pairs whose moments a binding has room for.
    fn most_intersections(&self, variant: &Variant) -> u32 {
        let bytes_each = u64::from(variant.blocks_per_tile()) * size_of::<types::SplatMoments>() as u64;
        (self.gpu.caps().max_storage_bytes / bytes_each).min(u64::from(u32::MAX)) as u32
    }

    /// The kernels of the backward pass, Adam among them.
    ///
    /// # Panics
    /// Before the first `prepare`.
    pub fn backward_pipelines(&self) -> &BackwardPipelines {
        let Some((_, backward)) = &self.pipelines else { unreachable!("prepare runs before every recording") };
        backward
    }

    /// Splats of a tile that the device's loops have iterations for; `u32::MAX` = any number.
    pub fn longest_list(&self) -> u32 {
        longest_list(&self.gpu, &self.variant)
    }

    /// Capacity of the buffers for (splat, tile) pairs.
    pub fn intersections(&self) -> u32 {
        self.intersections
    }

    /// The variant of the pipelines, whose tiles may be larger for the sake of large pictures.
    fn compiled_variant(&self) -> &Variant {
        self.pipelines.as_ref().map_or(&self.variant, |(forward, _)| &forward.variant)
    }

    /// The inputs and buffers of the passes, with the plan set to the size of the view.
    fn parts<'a>(&'a mut self, scene: &'a DeviceScene, view: &TrainView<'_>) -> Parts<'a> {
        let tile_size = self.compiled_variant().tile_size;
        let (Some((pipelines, backward)), Some((frame, buffers))) = (&self.pipelines, &mut self.buffers) else {
            unreachable!("prepare runs before every recording")
        };
        let size_px = [view.camera.width, view.camera.height];
        frame.plan.size_px = size_px;
        frame.plan.tiles = size_px.map(|side| side.div_ceil(tile_size));
        let forward = ForwardInputs {
            scene,
            pipelines,
            primitives: &self.primitives,
            view: view_of(view.camera, &view.options),
            background: view.options.background,
            // Training always uses full detail.
            lod_error_px: 0.0,
            // A step is one slab; `train_status` sees whether lists are too long.
            max_slab_splats: u32::MAX,
        };
        Parts { forward, pipelines: backward, frame, buffers }
    }
}

struct Parts<'a> {
    forward: ForwardInputs<'a>,
    pipelines: &'a BackwardPipelines,
    frame: &'a mut FrameBuffers,
    buffers: &'a mut BackwardBuffers,
}
