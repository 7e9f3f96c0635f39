//! The Gaussian at the surface of every pixel of a picture, on the device: kernel `tile_surface` after each depth slab.

use std::sync::Arc;

use crate::gpu::interface::constants::NO_INSTANCE;
use crate::gpu::staging::download;
use crate::gpu::{Buffer, Gpu, Grid, Recorder};
use crate::kernels::{SurfacePipelines, tile_surface};
use crate::scene::Camera;

use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::gradients::blocks_per_tile;
use super::renderer::{BlendedSlab, FrameStats, RenderOptions, Renderer};

/// The Gaussian at a pixel's surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfacePoint {
    /// The instance, by its index in the scene; the background's own is one more than the last.
    pub instance: u32,
    /// Index of the Gaussian in its template, or in the background.
    pub local: u32,
}

/// Whose surface each pixel shows.
pub struct Surfaces {
    gpu: Arc<Gpu>,
    pub(super) recorder: Recorder,
    pipelines: Option<SurfacePipelines>,
    /// Instance and local index; between slabs what the next one goes on from.
    pub(super) by_pixel: Buffer<[u32; 2]>,
    size_px: [u32; 2],
}

impl Surfaces {
    /// Without a picture.
    pub fn new(gpu: &Arc<Gpu>) -> Result<Self, RenderError> {
        let recorder = Recorder::new(gpu)?;
        Ok(Self {
            gpu: gpu.clone(),
            recorder,
            pipelines: None,
            by_pixel: Buffer::new(gpu, "surfaces", 1)?,
            size_px: [0; 2],
        })
    }

    /// What a pixel shows; `None` where half of the light passes, and outside the picture.
    pub fn at(&self, [x, y]: [u32; 2]) -> Result<Option<SurfacePoint>, RenderError> {
        if x >= self.size_px[0] || y >= self.size_px[1] {
            return Ok(None);
        }
        let index = y as usize * self.size_px[0] as usize + x as usize;
        let surfaces = download(&self.gpu, &self.by_pixel, index + 1)?;
        Ok(surfaces.last().and_then(|&s| point_of(s)))
    }

    /// [`Surfaces::at`] of all pixels, row by row.
    pub fn download(&self) -> Result<Vec<Option<SurfacePoint>>, RenderError> {
        let count = self.size_px[0] as usize * self.size_px[1] as usize;
        Ok(download(&self.gpu, &self.by_pixel, count)?.into_iter().map(point_of).collect())
    }

    pub(super) fn after_slab(&mut self, scene: &DeviceScene, slab: &BlendedSlab<'_>) -> Result<(), RenderError> {
        let (plan, variant) = (&slab.frame.plan, slab.variant);
        if self.size_px != plan.size_px {
            self.by_pixel = Buffer::new(&self.gpu, "surfaces", plan.pixels() as usize)?;
            self.size_px = plan.size_px;
        }
        if self.pipelines.as_ref().is_none_or(|p| p.variant != variant) {
            self.pipelines = Some(SurfacePipelines::new(slab.gpu, slab.cache, variant)?);
        }
        let Some(pipelines) = &self.pipelines else { return Ok(()) };
        let bindings = tile_surface::Bindings {
            splats: &slab.frame.splats,
            isect_values: &slab.frame.tile_sort.values,
            tile_ranges: &slab.frame.tile_ranges,
            work_items: &slab.frame.work_items,
            surfaces: &mut self.by_pixel,
            footprints: &slab.frame.footprints,
            counters: &slab.frame.scratch.counters,
            instances: &scene.instances,
        };
        let params =
            tile_surface::Params { size_px: plan.size_px, tiles: plan.tiles, chunk_size: variant.workgroup_size };
        self.recorder.dispatch(&pipelines.tile_surface, block_grid(slab), &params, bindings)?;
        let ticket = self.recorder.submit()?;
        Ok(self.recorder.wait(ticket)?)
    }
}

fn point_of([instance, local]: [u32; 2]) -> Option<SurfacePoint> {
    (instance != NO_INSTANCE).then_some(SurfacePoint { instance, local })
}

/// One subgroup per 8x8 block of every tile.
pub(super) fn block_grid(slab: &BlendedSlab<'_>) -> Grid {
    let variant = slab.variant;
    let blocks = slab.frame.plan.tile_count() * blocks_per_tile(variant.tile_size);
    Grid::groups(blocks.div_ceil(variant.blend_workgroup_size / variant.subgroup_size))
}

impl Renderer {
    /// As [`Renderer::render`], with the Gaussian at the surface of every pixel.
    ///
    /// # Errors
    /// As there.
    pub fn render_with_surfaces(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        surfaces: &mut Surfaces,
    ) -> Result<FrameStats, RenderError> {
        let stats = self.render_slabs(scene, camera, options, &mut |slab| surfaces.after_slab(scene, &slab));
        if stats.is_err() {
            surfaces.recorder.abandon();
        }
        stats
    }
}
