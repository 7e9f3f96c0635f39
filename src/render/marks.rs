//! Single splats of a picture drawn as marks, on the device: kernel `tile_marks` after the blend of each depth slab.

use std::sync::Arc;

use crate::gpu::interface::constants::{MARK_ELLIPSES, MARK_POINTS};
use crate::gpu::staging::download;
use crate::gpu::{Buffer, Gpu, GpuError, PipelineCache, Recorder};
use crate::kernels::{MarkPipelines, Variant, tile_marks};
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
use super::surfaces::Surfaces;

/// Shape of the mark of a splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MarkShape {
    /// A disc of 1.5 pixels around the centre.
    Points,
    /// The ellipse of one standard deviation, where alpha is at least this value.
    Ellipses(f32),
}

/// Alpha below which splats are skipped and not listed in tiles.
const LEAST_ALPHA: f32 = 1.0 / 255.0;

/// The nearest mark of each pixel.
pub struct Marks {
    gpu: Arc<Gpu>,
    pipelines: Option<MarkPipelines>,
    /// Packed by pixel: red, green, blue and 255 from the lowest byte; 0 without a mark.
    pub(super) by_pixel: Buffer<u32>,
    size_px: [u32; 2],
}

impl Marks {
    /// Creates marks of an empty picture.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        Ok(Self { gpu: gpu.clone(), pipelines: None, by_pixel: Buffer::new(gpu, "marks", 1)?, size_px: [0; 2] })
    }

    /// Width and height of the picture that these are of, pixels; zero before the first.
    pub(super) fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    /// Red, green and blue by pixel, row by row; `None` where there is no mark. Waits for the device.
    pub fn download(&self) -> Result<Vec<Option<[u8; 3]>>, RenderError> {
        let count = self.size_px[0] as usize * self.size_px[1] as usize;
        let rgb = |mark: u32| {
            let [r, g, b, _] = mark.to_le_bytes();
            (mark != 0).then_some([r, g, b])
        };
        Ok(download(&self.gpu, &self.by_pixel, count)?.into_iter().map(rgb).collect())
    }

    /// Recreates buffer and pipeline if they do not fit the picture.
    pub(super) fn prepare(
        &mut self,
        cache: &PipelineCache,
        variant: Variant,
        plan: &FramePlan,
    ) -> Result<(), RenderError> {
        if self.size_px != plan.size_px {
            self.by_pixel = Buffer::new(&self.gpu, "marks", plan.pixels() as usize)?;
            self.size_px = plan.size_px;
        }
        if self.pipelines.as_ref().is_none_or(|p| p.variant != variant) {
            self.pipelines = Some(MarkPipelines::new(&self.gpu, cache, variant)?);
        }
        Ok(())
    }

    /// Records kernel `tile_marks` for a slab.
    pub(super) fn record(
        &mut self,
        recorder: &mut Recorder,
        inputs: &ForwardInputs<'_>,
        frame: &FrameBuffers,
        shape: MarkShape,
    ) -> Result<(), GpuError> {
        let (plan, variant) = (&frame.plan, inputs.pipelines.variant);
        let Some(pipelines) = &self.pipelines else { return Ok(()) };
        let bindings = tile_marks::Bindings {
            splats: &frame.splats,
            isect_values: &frame.tile_sort.values,
            tile_ranges: &frame.tile_ranges,
            counters: &frame.scratch.counters,
            marks: &mut self.by_pixel,
        };
        let (shape, alpha_min) = match shape {
            MarkShape::Points => (MARK_POINTS, LEAST_ALPHA),
            MarkShape::Ellipses(alpha) => (MARK_ELLIPSES, alpha.max(LEAST_ALPHA)),
        };
        let params = tile_marks::Params { size_px: plan.size_px, tiles: plan.tiles, shape, alpha_min };
        recorder.dispatch(&pipelines.tile_marks, block_grid(plan, &variant), &params, bindings)
    }
}

impl Renderer {
    /// The same as [`Renderer::render`], with marks on its splats and, if asked for, the id buffer.
    ///
    /// # Errors
    /// The same errors as [`Renderer::render`].
    pub fn render_with_marks(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        marks: &mut Marks,
        shape: MarkShape,
        surfaces: Option<&mut Surfaces>,
    ) -> Result<FrameStats, RenderError> {
        self.render_with(scene, camera, options, ExtraPasses { surfaces, marks: Some((marks, shape)) })
    }
}
