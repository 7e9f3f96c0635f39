//! The last picture of a [`Renderer`] as the pixels of a window, without a copy on the host.

use std::sync::Arc;

use crate::gpu::interface::constants::{SHOW_ALPHA, SHOW_COLOR, SHOW_DEPTH, SHOW_INSTANCES};
use crate::gpu::staging::{download, upload};
use crate::gpu::{Buffer, Gpu, Grid, PipelineCache, Recorder, user_cache_path};
use crate::kernels::{PresentPipelines, present};

use super::error::RenderError;
use super::renderer::Renderer;
use super::surfaces::Surfaces;

/// What a window shows of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Show {
    /// Colour over the background.
    #[default]
    Color,
    /// Coverage, 1 - T, as grey.
    Alpha,
    /// View depth as grey, from white at the first of these depths to black at the second; scene units.
    Depth([f32; 2]),
    /// A colour for each instance, black where there is none; needs surfaces.
    Instances,
}

const BLACK: u32 = 0xFF00_0000;

/// Makes pixels of pictures.
pub struct Presenter {
    gpu: Arc<Gpu>,
    pipelines: PresentPipelines,
    workgroup_size: u32,
    pixels: Buffer<u32>,
    shown_px: [u32; 2],
    /// 1 for chosen instances.
    chosen: Buffer<u32>,
    instance_count: u32,
    no_surfaces: Buffer<[u32; 2]>,
}

impl Presenter {
    /// For pictures of a renderer.
    pub fn new(gpu: &Arc<Gpu>, renderer: &Renderer) -> Result<Self, RenderError> {
        let cache = PipelineCache::new(gpu, user_cache_path(&gpu.caps().name).as_deref())?;
        Ok(Self {
            gpu: gpu.clone(),
            pipelines: PresentPipelines::new(gpu, &cache, renderer.variant())?,
            workgroup_size: renderer.variant().workgroup_size,
            pixels: Buffer::new(gpu, "pixels", 1)?,
            shown_px: [0; 2],
            chosen: Buffer::new(gpu, "chosen", 1)?,
            instance_count: 0,
            no_surfaces: Buffer::new(gpu, "no surfaces", 1)?,
        })
    }

    /// Says by instance which ones are chosen: a line is drawn around them.
    pub fn set_chosen(&mut self, chosen: &[bool]) -> Result<(), RenderError> {
        let flags: Vec<u32> = chosen.iter().map(|&is| u32::from(is)).collect();
        self.chosen = upload(&self.gpu, "chosen", &flags)?;
        self.instance_count = flags.len() as u32;
        Ok(())
    }

    /// Records the renderer's last picture as pixels of a window of `shown_px`; black if there is no picture. `surfaces` are
    /// that picture's, for lines around what is chosen and for [`Show::Instances`]. A picture on its way that will not be
    /// complete (see [`Ahead`](super::Ahead)) leaves the pixels as they are, or black if the window has a new size.
    ///
    /// # Errors
    /// A window larger than the device's buffers.
    pub fn record(
        &mut self,
        recorder: &mut Recorder,
        renderer: &Renderer,
        (show, surfaces): (Show, Option<&Surfaces>),
        (shown_px, blue_first): ([u32; 2], bool),
    ) -> Result<(), RenderError> {
        if self.shown_px != shown_px {
            self.pixels = Buffer::new(&self.gpu, "pixels", shown_px[0] as usize * shown_px[1] as usize)?;
            self.shown_px = shown_px;
            recorder.fill(&mut self.pixels, BLACK)?;
        }
        let Some(frame) = renderer.frame() else {
            return Ok(recorder.fill(&mut self.pixels, BLACK)?);
        };
        let (show, depth_range) = match show {
            Show::Color => (SHOW_COLOR, [0.0; 2]),
            Show::Alpha => (SHOW_ALPHA, [0.0; 2]),
            Show::Depth(range) => (SHOW_DEPTH, range),
            Show::Instances => (SHOW_INSTANCES, [0.0; 2]),
        };
        let size_px = frame.plan.size_px;
        let instance_count = if surfaces.is_some() { self.instance_count } else { 0 };
        let blue_first = u32::from(blue_first);
        let capacities = [frame.plan.capacities.candidates, frame.plan.capacities.work_items];
        let params = present::Params { size_px, shown_px, show, blue_first, depth_range, instance_count, capacities };
        let bindings = present::Bindings {
            colors: &frame.colors,
            depths: &frame.depths,
            surfaces: surfaces.map_or(&self.no_surfaces, |s| &s.by_pixel),
            chosen: &self.chosen,
            counters: &frame.scratch.counters,
            pixels: &mut self.pixels,
        };
        let grid = Grid::threads(shown_px[0] * shown_px[1], self.workgroup_size);
        Ok(recorder.dispatch(&self.pipelines.present, grid, &params, bindings)?)
    }

    /// The pixels recorded last: one u32 each, row by row from the top.
    pub fn pixels(&self) -> &Buffer<u32> {
        &self.pixels
    }

    /// The pixels on the host, as bytes red, green, blue; they must have been recorded with red first, and submitted.
    pub fn rgb8(&self) -> Result<Vec<u8>, RenderError> {
        let count = self.shown_px[0] as usize * self.shown_px[1] as usize;
        let pixels = download(&self.gpu, &self.pixels, count)?;
        Ok(pixels
            .iter()
            .flat_map(|p| {
                let [r, g, b, _] = p.to_le_bytes();
                [r, g, b]
            })
            .collect())
    }
}
