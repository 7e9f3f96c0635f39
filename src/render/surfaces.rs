//! The id buffer of a picture, on the device: the Gaussian at the surface of every pixel, by kernel `tile_surface`
//! after the blend of each depth slab.

use std::sync::Arc;

use crate::gpu::interface::constants::NO_INSTANCE;
use crate::gpu::staging::{download, download_from};
use crate::gpu::{Buffer, Gpu, GpuError, PipelineCache, Recorder};
use crate::kernels::{SurfacePipelines, Variant, tile_surface};
use crate::scene::Camera;

use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::extra_passes::{ExtraPasses, block_grid};
use super::forward::ForwardInputs;
use super::frame_buffers::FrameBuffers;
use super::frame_stats::FrameStats;
use super::plan::FramePlan;
use super::render_options::RenderOptions;
use super::renderer::Renderer;

/// The Gaussian at a pixel's surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfacePoint {
    /// Index of the instance in the scene; the background's is one more than the last.
    pub instance: u32,
    /// Index of the Gaussian in its template, after all of these among the instance's own, or in the background. In a scene with
    /// levels of detail or in pages: in the level or the block of the background that is drawn.
    pub local: u32,
}

/// The id buffer: instance and Gaussian at the surface of each pixel.
pub struct Surfaces {
    gpu: Arc<Gpu>,
    pipelines: Option<SurfacePipelines>,
    /// Instance and local index by pixel; between slabs the state that the next slab continues from.
    pub(super) by_pixel: Buffer<[u32; 2]>,
    size_px: [u32; 2],
}

impl Surfaces {
    /// Creates the id buffer of an empty picture.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        Ok(Self { gpu: gpu.clone(), pipelines: None, by_pixel: Buffer::new(gpu, "surfaces", 1)?, size_px: [0; 2] })
    }

    /// Width and height of the picture that these are of, pixels; zero before the first.
    pub(super) fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// The Gaussian at the surface of a pixel; `None` where at least half of the light passes, and outside the picture.
    /// Waits for the device and reads one element.
    pub fn at(&self, [x, y]: [u32; 2]) -> Result<Option<SurfacePoint>, RenderError> {
        if x >= self.size_px[0] || y >= self.size_px[1] {
            return Ok(None);
        }
        let index = y as usize * self.size_px[0] as usize + x as usize;
        let surfaces = download_from(&self.gpu, &self.by_pixel, index, 1)?;
        Ok(surfaces.first().and_then(|&s| point_of(s)))
    }

    /// [`Surfaces::at`] of all pixels, row by row.
    pub fn download(&self) -> Result<Vec<Option<SurfacePoint>>, RenderError> {
        let count = self.size_px[0] as usize * self.size_px[1] as usize;
        Ok(download(&self.gpu, &self.by_pixel, count)?.into_iter().map(point_of).collect())
    }

    /// Recreates buffer and pipeline if they do not fit the picture.
    pub(super) fn prepare(
        &mut self,
        cache: &PipelineCache,
        variant: Variant,
        plan: &FramePlan,
    ) -> Result<(), RenderError> {
        if self.size_px != plan.size_px {
            self.by_pixel = Buffer::new(&self.gpu, "surfaces", plan.pixels() as usize)?;
            self.size_px = plan.size_px;
        }
        if self.pipelines.as_ref().is_none_or(|p| p.variant != variant) {
            self.pipelines = Some(SurfacePipelines::new(&self.gpu, cache, variant)?);
        }
        Ok(())
    }

    /// Records kernel `tile_surface` for a slab.
    pub(super) fn record(
        &mut self,
        recorder: &mut Recorder,
        inputs: &ForwardInputs<'_>,
        frame: &FrameBuffers,
    ) -> Result<(), GpuError> {
        let (plan, variant) = (&frame.plan, inputs.pipelines.variant);
        let Some(pipelines) = &self.pipelines else { return Ok(()) };
        let bindings = tile_surface::Bindings {
            splats: &frame.splats,
            isect_values: &frame.tile_sort.values,
            tile_ranges: &frame.tile_ranges,
            work_items: &frame.work_items,
            surfaces: &mut self.by_pixel,
            footprints: &frame.footprints,
            counters: &frame.scratch.counters,
            instances: &inputs.scene.instances,
        };
        let params =
            tile_surface::Params { size_px: plan.size_px, tiles: plan.tiles, chunk_size: variant.workgroup_size };
        recorder.dispatch(&pipelines.tile_surface, block_grid(plan, &variant), &params, bindings)
    }
}

fn point_of([instance, local]: [u32; 2]) -> Option<SurfacePoint> {
    (instance != NO_INSTANCE).then_some(SurfacePoint { instance, local })
}

impl Renderer {
    /// The same as [`Renderer::render`], with the id buffer.
    ///
    /// # Errors
    /// The same errors as [`Renderer::render`].
    pub fn render_with_surfaces(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        surfaces: &mut Surfaces,
    ) -> Result<FrameStats, RenderError> {
        self.render_with(scene, camera, options, ExtraPasses { surfaces: Some(surfaces), marks: None })
    }
}
