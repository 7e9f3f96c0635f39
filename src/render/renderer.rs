//! Renders frames: records, submits, and grows buffers that the counters show to be too small.

mod depth_ranges;
mod growth;
mod slabs;

use std::sync::Arc;

use crate::gpu::interface::constants::*;
use crate::gpu::interface::types;
use crate::gpu::staging::download;
use crate::gpu::{Gpu, GpuError, PipelineCache, Recorder, user_cache_path};
use crate::kernels::variant::BLOCK_SIDE;
use crate::kernels::{Pipelines, Primitives, Purpose, SceneTraits, Variant};
use crate::scene::Camera;
use crate::scene::lod::pages::PageTable;

use super::device_scene::{DeviceScene, Holding};
use super::error::RenderError;
use super::extra_passes::ExtraPasses;
use super::forward::ForwardInputs;
use super::frame_buffers::FrameBuffers;
use super::frame_stats::FrameStats;
use super::paged_scene::PagedScene;
use super::picture::Picture;
use super::plan::{Capacities, FramePlan, INITIAL};
use super::render_options::{RenderOptions, view_of};
use super::self_test::{first_sound, self_test};
use growth::Growth;
use slabs::{AfterSlab, Start};
pub(super) use slabs::{BlendedSlab, Counters, EachSlab, purpose_of};

/// Forward kernels by what they are for, so that a view that changes between the two does not compile anew.
#[derive(Default)]
struct PipelineSets {
    whole: Option<Pipelines>,
    layered: Option<Pipelines>,
}

impl PipelineSets {
    fn of(&self, purpose: Purpose) -> Option<&Pipelines> {
        match purpose {
            Purpose::Layered => self.layered.as_ref(),
            Purpose::Whole | Purpose::Training => self.whole.as_ref(),
        }
    }

    fn set(&mut self, pipelines: Pipelines) {
        match pipelines.purpose {
            Purpose::Layered => self.layered = Some(pipelines),
            Purpose::Whole | Purpose::Training => self.whole = Some(pipelines),
        }
    }
}

/// Renders one scene at a time and keeps its frame buffers between frames.
pub struct Renderer {
    gpu: Arc<Gpu>,
    cache: PipelineCache,
    variant: Variant,
    primitives: Primitives,
    pipelines: PipelineSets,
    frame: Option<FrameBuffers>,
    /// True while nothing was drawn to the buffers of `frame`.
    is_undrawn: bool,
    capacities: Capacities,
    /// The largest intersection buffer that could be allocated.
    most_intersections: u32,
    /// The most visible chunks whose buffers could be allocated, for frames that may be divided for it.
    most_chunks: u32,
    /// Why there are no larger ones.
    shortage: Option<GpuError>,
    /// The limit of visible chunks that the last frame was beyond, so that it was drawn in depth ranges.
    beyond_chunks: Option<u32>,
    recorder: Recorder,
}

impl Renderer {
    /// Creates a renderer with the variant for the device: the first subgroup size, in order of preference, whose scan
    /// and sort pass the self-test. Some drivers miscompile some sizes.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        Self::with_first_sound_variant(gpu, false)
    }

    /// The same as [`Renderer::new`]; every pass is timed.
    pub fn profiled(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        Self::with_first_sound_variant(gpu, true)
    }

    fn with_first_sound_variant(gpu: &Arc<Gpu>, profile: bool) -> Result<Self, RenderError> {
        let preferred = Variant::for_device(gpu.caps());
        first_sound(preferred, preferred.fallbacks(gpu.caps()), |variant| Self::with_variant(gpu, variant, profile))
    }

    /// Creates a renderer for a given variant; `profile` times every pass.
    ///
    /// # Errors
    /// The variant fails the self-test on this device.
    pub fn with_variant(gpu: &Arc<Gpu>, variant: Variant, profile: bool) -> Result<Self, RenderError> {
        let cache = PipelineCache::new(gpu, user_cache_path(&gpu.caps().name).as_deref())?;
        let primitives = Primitives::new(gpu, &cache, &variant)?;
        self_test(gpu, &primitives, &variant)?;
        Ok(Self {
            gpu: gpu.clone(),
            cache,
            variant,
            primitives,
            pipelines: PipelineSets::default(),
            frame: None,
            is_undrawn: false,
            capacities: INITIAL,
            most_intersections: u32::MAX,
            most_chunks: u32::MAX,
            shortage: None,
            beyond_chunks: None,
            recorder: if profile { Recorder::with_profiler(gpu)? } else { Recorder::new(gpu)? },
        })
    }

    /// The same with tiles of 8x8 pixels, for passes that write something for every block of a tile.
    pub(super) fn with_tiles_of_one_block(mut self) -> Self {
        self.variant.tile_size = BLOCK_SIDE;
        self
    }

    /// The device of this renderer.
    pub(super) fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// The kernel variant; scenes are uploaded with its `workgroup_size` as chunk size.
    pub fn variant(&self) -> &Variant {
        &self.variant
    }

    /// Sets the initial capacities of the growing buffers; frames grow them as needed.
    pub fn set_capacities(&mut self, capacities: Capacities) {
        self.capacities = capacities;
    }

    /// Frees the memory of the last picture and resets its capacities, before a different scene is rendered.
    pub fn forget_picture(&mut self) {
        (self.frame, self.capacities, self.beyond_chunks) = (None, INITIAL, None);
        (self.most_intersections, self.most_chunks, self.shortage) = (u32::MAX, u32::MAX, None);
    }

    /// Uploads a scene for this renderer, in f32.
    pub fn upload(&self, scene: &crate::scene::InstancedScene) -> Result<DeviceScene, RenderError> {
        DeviceScene::new(&self.gpu, scene, self.variant.workgroup_size, Holding::default())
    }

    /// Uploads a scene in the precision of `options`, with levels of detail if their `lod_error_px` is above 0. Such a scene
    /// can also be rendered at full detail or with any other error. With `divide_for_memory`, a scene that is too large for the
    /// device's memory stays in host memory.
    pub fn upload_for(
        &self,
        scene: &crate::scene::InstancedScene,
        options: &RenderOptions,
    ) -> Result<DeviceScene, RenderError> {
        let upload = if options.lod_error_px > 0.0 { DeviceScene::with_levels } else { DeviceScene::new };
        let holding = Holding { precision: options.device_precision, on_host_if_large: options.divide_for_memory };
        upload(&self.gpu, scene, self.variant.workgroup_size, holding)
    }

    /// Uploads a scene whose background is in pages, with stand-ins as its background, and room for `slots` pages.
    ///
    /// # Errors
    /// The errors of [`PagedScene::new`].
    pub fn upload_in_pages(
        &self,
        scene: &crate::scene::InstancedScene,
        table: PageTable,
        slots: u32,
        options: &RenderOptions,
    ) -> Result<PagedScene, RenderError> {
        let precision = options.device_precision;
        PagedScene::new(&self.gpu, scene, table, slots, self.variant.workgroup_size, precision)
    }

    /// Renders a picture and leaves it on the device (see [`Renderer::download`]).
    ///
    /// # Errors
    /// The camera or an option is invalid, or the scene exceeds the device's limits. A buffer that is too small grows.
    pub fn render(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<FrameStats, RenderError> {
        self.slabs(scene, camera, options, EachSlab::Blend(ExtraPasses::default()))
    }

    /// The same as [`Renderer::render`], if lists suffice: the last slab is not blended, and there is no picture. Pass
    /// times are those of the last slab.
    pub(super) fn list_slabs<'a>(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        after_slab: &'a mut AfterSlab<'a>,
    ) -> Result<FrameStats, RenderError> {
        self.slabs(scene, camera, options, EachSlab::List(after_slab))
    }

    /// Renders a picture, or its lists only.
    pub(super) fn slabs(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        mut each: EachSlab<'_>,
    ) -> Result<FrameStats, RenderError> {
        let divides = options.divide_for_memory && each.is_blend_only();
        let options = &RenderOptions { divide_for_memory: divides, ..*options };
        self.prepare(each.purpose(options), scene, camera, options)?;
        let stats = self.render_prepared(scene, camera, options, &mut each);
        if stats.is_err() {
            self.recorder.abandon();
        }
        self.note_drawn(stats.is_ok());
        stats
    }

    /// Notes whether a picture was submitted to the buffers of the frame. New ones that nothing was drawn to hold no picture:
    /// they are dropped.
    pub(super) fn note_drawn(&mut self, drawn: bool) {
        if !drawn && self.is_undrawn {
            self.frame = None;
        }
        self.is_undrawn = false;
    }

    /// Checks the inputs, and creates pipelines and buffers for them.
    pub(super) fn prepare(
        &mut self,
        purpose: Purpose,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<(), RenderError> {
        camera.validate().map_err(RenderError::Camera)?;
        options.check()?;
        if scene.chunk_size != self.variant.workgroup_size {
            let reason = format!("{} Gaussians, this renderer has {}", scene.chunk_size, self.variant.workgroup_size);
            return Err(RenderError::Option { option: "the scene's chunks", reason });
        }
        if options.lod_error_px > 0.0 && !scene.has_levels() {
            let reason = "the scene was uploaded without levels of detail".into();
            return Err(RenderError::Option { option: "lod", reason });
        }
        self.prepare_pipelines(purpose, scene.traits(scene.sh_degree), [camera.width, camera.height])?;
        self.prepare_frame(scene, camera, options)
    }

    /// Creates the resources of optional passes, after [`Renderer::prepare`].
    pub(super) fn prepare_extra(&self, extra: &mut ExtraPasses<'_>) -> Result<(), RenderError> {
        if extra.is_empty() {
            return Ok(());
        }
        let (Some(pipelines), Some(frame)) = (&self.pipelines.whole, &self.frame) else { unreachable_state() };
        extra.prepare(&self.cache, pipelines.variant, &frame.plan)
    }

    /// The inputs and buffers of the passes, after [`Renderer::prepare`].
    pub(super) fn passes<'a>(
        &'a mut self,
        purpose: Purpose,
        scene: &'a DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> (ForwardInputs<'a>, &'a mut FrameBuffers) {
        let (Some(pipelines), Some(frame)) = (self.pipelines.of(purpose), &mut self.frame) else { unreachable_state() };
        let view = view_of(camera, options);
        (Self::inputs(pipelines, &self.primitives, &self.gpu, scene, view, options), frame)
    }

    fn render_prepared(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        each: &mut EachSlab<'_>,
    ) -> Result<FrameStats, RenderError> {
        let most = self.most_work_items_of(options);
        if each.is_blend_only() && self.beyond_chunks.is_some_and(|limit| most <= limit) {
            return self.render_in_ranges(scene, camera, options, each);
        }
        self.beyond_chunks = None;
        let view = view_of(camera, options);
        let last_layer = each.purpose(options).last_layer();
        let mut redone = 0;
        'frame: loop {
            self.prepare_frame(scene, camera, options)?;
            if let EachSlab::Blend(extra) = each {
                self.prepare_extra(extra)?;
            }
            let mut stats = FrameStats { redone, layers: last_layer + 1, ..FrameStats::default() };
            let mut counters = [0; COUNTER_COUNT as usize];
            counters[COUNTER_INSTANCES as usize] = scene.instance_count;
            counters[COUNTER_LAST_LAYER as usize] = last_layer;
            for layer in 0..=last_layer {
                counters[COUNTER_LAYER as usize] = layer;
                counters[COUNTER_SLAB_BEGIN as usize] = 0;
                let start = if layer == 0 { Start::Frame } else { Start::Layer };
                counters = self.submit_slab(scene, view, options, each, counters, start)?;
                let Some(frame) = &self.frame else { unreachable_state() };
                let most = self.most_work_items_of(options);
                match self.grow(scene.chunk_pairs, frame.plan.capacities, &counters, most)? {
                    Growth::Fits => {}
                    Growth::Grown => {
                        redone += 1;
                        continue 'frame;
                    }
                    Growth::Beyond { .. } if each.is_blend_only() => {
                        return self.render_in_ranges(scene, camera, options, each);
                    }
                    Growth::Beyond { most } => {
                        check_fits("visible chunks", counters[COUNTER_WORK_ITEMS_NEEDED as usize], most)?;
                    }
                }
                stats.passes_ms.extend(self.recorder.passes_ms()?);
                self.slab_done(each, layer == 0, &counters)?;
                counters = self.finish_slabs(scene, view, options, each, counters, &mut stats)?;
            }
            return Ok(stats);
        }
    }

    /// Downloads the last picture. Waits for the device.
    pub fn download(&self) -> Result<Picture, RenderError> {
        let Some(frame) = &self.frame else { return Ok(Picture::default()) };
        let pixels = frame.plan.pixels() as usize;
        Ok(Picture {
            width: frame.plan.size_px[0],
            height: frame.plan.size_px[1],
            colors: download(&self.gpu, &frame.colors, pixels)?,
            depths: download(&self.gpu, &frame.depths, pixels)?.into_iter().map(|d| d[0]).collect(),
        })
    }

    /// The buffers of the last frame, for tests of single passes.
    pub fn frame(&self) -> Option<&FrameBuffers> {
        self.frame.as_ref()
    }

    fn inputs<'a>(
        pipelines: &'a Pipelines,
        primitives: &'a Primitives,
        gpu: &Gpu,
        scene: &'a DeviceScene,
        view: types::View,
        options: &RenderOptions,
    ) -> ForwardInputs<'a> {
        let max_slab_splats = longest_list(gpu, &pipelines.variant);
        let (background, lod_error_px) = (options.background, options.lod_error_px);
        ForwardInputs { scene, pipelines, primitives, view, background, lod_error_px, max_slab_splats }
    }

    fn prepare_pipelines(
        &mut self,
        purpose: Purpose,
        traits: SceneTraits,
        size_px: [u32; 2],
    ) -> Result<(), RenderError> {
        let variant = Variant { tile_size: tile_size_for(&self.gpu, &self.variant, size_px), ..self.variant };
        if self.pipelines.of(purpose).is_none_or(|p| p.traits != traits || p.variant != variant) {
            self.pipelines.set(Pipelines::new(&self.gpu, &self.cache, variant, traits, purpose)?);
        }
        Ok(())
    }

    /// Makes the frame buffers fit image, scene and capacities.
    fn prepare_frame(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Result<(), RenderError> {
        let mut capacities = self.capacities;
        capacities.work_items = capacities.work_items.min(options.max_chunks.unwrap_or(u32::MAX)).max(1);
        if let Some(most) = options.max_intersections {
            capacities.intersections = capacities.intersections.min(most);
        }
        let pairs = u32::try_from(scene.chunk_pairs).unwrap_or(u32::MAX).max(1);
        capacities.candidates = capacities.candidates.min(pairs);
        capacities.work_items = capacities.work_items.min(pairs);
        let size = [camera.width, camera.height];
        let workgroup = self.variant.workgroup_size;
        let tile_size = tile_size_for(&self.gpu, &self.variant, size);
        let most_before = (self.most_intersections, self.most_chunks);
        let mut shortage = None;
        loop {
            capacities.intersections = capacities.intersections.min(self.most_intersections);
            if options.divide_for_memory {
                capacities.work_items = capacities.work_items.min(self.most_chunks);
            }
            let plan = FramePlan::new(size, tile_size, scene.instance_count, capacities, workgroup);
            let plan = FramePlan { layered: options.occlusion || self.beyond_chunks.is_some(), ..plan };
            if self.frame.as_ref().is_some_and(|frame| frame.plan == plan) {
                return Ok(());
            }
            // Free the old buffers first: both sets at once may not fit.
            self.frame = None;
            let frame = match options.divide_for_memory {
                true => self.divisible_buffers(plan),
                false => FrameBuffers::new(&self.gpu, plan),
            };
            match frame {
                Ok(frame) => {
                    (self.frame, self.is_undrawn) = (Some(frame), true);
                    if self.most_chunks < most_before.1 {
                        self.shortage = shortage;
                    }
                    return Ok(());
                }
                Err(error @ GpuError::OutOfMemory { .. })
                    if self.make_do_with_less(&plan, options.divide_for_memory) =>
                {
                    shortage.get_or_insert(error);
                }
                Err(error) => {
                    // The allocation failed anyway, so the reduced sizes must not limit later attempts. What was wanted at
                    // first says more of what is missing than the least.
                    (self.most_intersections, self.most_chunks) = most_before;
                    return Err(shortage.unwrap_or(error).into());
                }
            }
        }
    }
}

/// Largest number of splats in a tile's list, and so in a slab: the loops of the blends take some iterations per subgroup of splats;
/// one in 16 iterations is reserved for the other loops of the kernels.
pub(super) fn longest_list(gpu: &Gpu, variant: &Variant) -> u32 {
    let fitting = |most: u32| (most - most / 16) / variant.iterations_per_subgroup_of_splats();
    gpu.caps().loop_iteration_limit.map_or(u32::MAX, |most| fitting(most) * variant.subgroup_size)
}

/// The variant's tile size, doubled until a splat over the whole image can be emitted within the driver's loop limit
/// (an iteration per tile and per row). The picture does not depend on it.
pub(super) fn tile_size_for(gpu: &Gpu, variant: &Variant, size_px: [u32; 2]) -> u32 {
    let most = gpu.caps().loop_iteration_limit.map_or(u64::MAX, |most| u64::from(most - most / 16));
    let mut tile_size = variant.tile_size;
    loop {
        let [columns, rows] = size_px.map(|side| u64::from(side.div_ceil(tile_size)));
        if (columns + 1) * rows <= most {
            return tile_size;
        }
        tile_size *= 2;
    }
}

/// `prepare_pipelines` and `prepare_frame` run before every use; a private invariant, not an input error.
fn unreachable_state() -> ! {
    unreachable!("render prepares pipelines and frame buffers first")
}

pub(super) fn check_fits(what: &'static str, needed: u32, limit: u32) -> Result<(), RenderError> {
    if needed > limit {
        return Err(RenderError::TooMany { what, needed: u64::from(needed), limit: u64::from(limit) });
    }
    Ok(())
}
