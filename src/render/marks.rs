//! Single splats of a picture as marks, on the device: kernel `tile_marks` after each depth slab.

use std::sync::Arc;

use crate::gpu::interface::constants::{MARK_ELLIPSES, MARK_POINTS};
use crate::gpu::staging::download;
use crate::gpu::{Buffer, Gpu, Recorder};
use crate::kernels::{MarkPipelines, tile_marks};
use crate::scene::Camera;

use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::renderer::{BlendedSlab, FrameStats, RenderOptions, Renderer};
use super::surfaces::{Surfaces, block_grid};

/// What marks a splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MarkShape {
    /// A disc of 1.5 pixels around the centre.
    Points,
    /// The ellipse of one standard deviation, as far as alpha is at least this.
    Ellipses(f32),
}

/// Splats are skipped, and left out of tiles, where their alpha is smaller.
const LEAST_ALPHA: f32 = 1.0 / 255.0;

/// The nearest mark of each pixel.
pub struct Marks {
    gpu: Arc<Gpu>,
    recorder: Recorder,
    pipelines: Option<MarkPipelines>,
    /// Red, green, blue and 255 from the lowest byte; 0 without a mark.
    pub(super) by_pixel: Buffer<u32>,
    size_px: [u32; 2],
}

impl Marks {
    /// Without a picture.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        Ok(Self {
            gpu: gpu.clone(),
            recorder: Recorder::new(gpu)?,
            pipelines: None,
            by_pixel: Buffer::new(gpu, "marks", 1)?,
            size_px: [0; 2],
        })
    }

    /// Red, green and blue by pixel, row by row; `None` without a mark.
    pub fn download(&self) -> Result<Vec<Option<[u8; 3]>>, RenderError> {
        let count = self.size_px[0] as usize * self.size_px[1] as usize;
        let rgb = |mark: u32| {
            let [r, g, b, _] = mark.to_le_bytes();
            (mark != 0).then_some([r, g, b])
        };
        Ok(download(&self.gpu, &self.by_pixel, count)?.into_iter().map(rgb).collect())
    }

    fn after_slab(&mut self, slab: &BlendedSlab<'_>, shape: MarkShape) -> Result<(), RenderError> {
        let plan = &slab.frame.plan;
        if self.size_px != plan.size_px {
            self.by_pixel = Buffer::new(&self.gpu, "marks", plan.pixels() as usize)?;
            self.size_px = plan.size_px;
        }
        if self.pipelines.as_ref().is_none_or(|p| p.variant != slab.variant) {
            self.pipelines = Some(MarkPipelines::new(slab.gpu, slab.cache, slab.variant)?);
        }
        let Some(pipelines) = &self.pipelines else { return Ok(()) };
        let bindings = tile_marks::Bindings {
            splats: &slab.frame.splats,
            isect_values: &slab.frame.tile_sort.values,
            tile_ranges: &slab.frame.tile_ranges,
            counters: &slab.frame.scratch.counters,
            marks: &mut self.by_pixel,
        };
        let (shape, alpha_min) = match shape {
            MarkShape::Points => (MARK_POINTS, LEAST_ALPHA),
            MarkShape::Ellipses(alpha) => (MARK_ELLIPSES, alpha.max(LEAST_ALPHA)),
        };
        let params = tile_marks::Params { size_px: plan.size_px, tiles: plan.tiles, shape, alpha_min };
        self.recorder.dispatch(&pipelines.tile_marks, block_grid(slab), &params, bindings)?;
        let ticket = self.recorder.submit()?;
        Ok(self.recorder.wait(ticket)?)
    }
}

impl Renderer {
    /// As [`Renderer::render`], with marks on its splats, and with the Gaussian at the surface of every pixel where that is
    /// asked for.
    ///
    /// # Errors
    /// As there.
    pub fn render_with_marks(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        (marks, shape): (&mut Marks, MarkShape),
        mut surfaces: Option<&mut Surfaces>,
    ) -> Result<FrameStats, RenderError> {
        let stats = self.render_slabs(scene, camera, options, &mut |slab| {
            marks.after_slab(&slab, shape)?;
            surfaces.as_mut().map_or(Ok(()), |surfaces| surfaces.after_slab(scene, &slab))
        });
        if stats.is_err() {
            marks.recorder.abandon();
            surfaces.into_iter().for_each(|surfaces| surfaces.recorder.abandon());
        }
        stats
    }
}
