//! Shows the last picture of a [`Renderer`] as the pixels of a window, without a copy on the host.

use std::sync::Arc;

use crate::gpu::interface::constants::SHOW_NOTHING;
use crate::gpu::staging::{download, upload};
use crate::gpu::{Buffer, Gpu, Grid, PipelineCache, Recorder, user_cache_path};
use crate::kernels::{PresentPipelines, PresentVariant, Variant, present};
use crate::scene::Parameter;

use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::marks::Marks;
use super::renderer::{Renderer, tile_size_for};
use super::show::Show;
use super::surfaces::Surfaces;

/// A picture to show, with its scene and optional passes.
#[derive(Clone, Copy)]
pub struct ShownPicture<'a> {
    /// The renderer, whose last picture is shown.
    pub renderer: &'a Renderer,
    /// The scene that the picture was made from.
    pub scene: &'a DeviceScene,
    /// Id buffer of that picture, for outlines of selected instances and for the views that need it.
    pub surfaces: Option<&'a Surfaces>,
    /// Marks of that picture, in the shape that the view needs.
    pub marks: Option<&'a Marks>,
}

/// Look of an instance in a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InstanceLook {
    /// True if an outline is drawn around the instance.
    pub chosen: bool,
    /// Index of the instance's template.
    pub template: u32,
}

const BLACK: u32 = 0xFF00_0000;

/// Converts pictures to window pixels.
pub struct Presenter {
    gpu: Arc<Gpu>,
    cache: PipelineCache,
    pipelines: PresentPipelines,
    variant: Variant,
    pixels: Buffer<u32>,
    shown_px: [u32; 2],
    /// By instance: 1 if it is selected, plus twice its template; on the device and on the host.
    looks: (Buffer<u32>, Vec<u32>),
    no_surfaces: Buffer<[u32; 2]>,
    no_marks: Buffer<u32>,
}

impl Presenter {
    /// Creates a presenter for the pictures of a renderer.
    pub fn new(gpu: &Arc<Gpu>, renderer: &Renderer) -> Result<Self, RenderError> {
        let cache = PipelineCache::new(gpu, user_cache_path(&gpu.caps().name).as_deref())?;
        Ok(Self {
            gpu: gpu.clone(),
            cache,
            pipelines: PresentPipelines::default(),
            variant: *renderer.variant(),
            pixels: Buffer::new(gpu, "pixels", 1)?,
            shown_px: [0; 2],
            looks: (Buffer::new(gpu, "looks", 1)?, Vec::new()),
            no_surfaces: Buffer::new(gpu, "no surfaces", 1)?,
            no_marks: Buffer::new(gpu, "no marks", 1)?,
        })
    }

    /// Sets the template and selection of every instance; the background has no entry.
    pub fn set_instances(&mut self, looks: &[InstanceLook]) -> Result<(), RenderError> {
        let packed: Vec<u32> = looks.iter().map(|look| u32::from(look.chosen) | look.template << 1).collect();
        if packed != self.looks.1 {
            self.looks = (upload(&self.gpu, "looks", &packed)?, packed);
        }
        Ok(())
    }

    /// Records the picture as pixels of a window of `shown_px`; black if there is none, or if the view's needs are
    /// missing. A frame in flight that turns out incomplete (see [`Ahead`](super::Ahead)) leaves the pixels unchanged,
    /// or black if the window has a new size.
    ///
    /// # Errors
    /// The window exceeds the device's buffer limit.
    pub fn record(
        &mut self,
        recorder: &mut Recorder,
        show: Show,
        picture: ShownPicture<'_>,
        shown_px: [u32; 2],
        blue_first: bool,
    ) -> Result<(), RenderError> {
        if self.shown_px != shown_px {
            self.pixels = Buffer::new(&self.gpu, "pixels", shown_px[0] as usize * shown_px[1] as usize)?;
            self.shown_px = shown_px;
            recorder.fill(&mut self.pixels, BLACK)?;
        }
        let Some(frame) = picture.renderer.frame() else {
            return Ok(recorder.fill(&mut self.pixels, BLACK)?);
        };
        // A failed frame leaves those of the picture before.
        let size_px = frame.plan.size_px;
        let picture = ShownPicture {
            surfaces: picture.surfaces.filter(|surfaces| surfaces.size_px() == size_px),
            marks: picture.marks.filter(|marks| marks.size_px() == size_px),
            ..picture
        };
        let capacities = [frame.plan.capacities.candidates, frame.plan.capacities.work_items];
        let blue_first = u32::from(blue_first);
        let params = present::Params { shown_px, blue_first, capacities, ..self.params(show, picture) };
        let variant = self.present_variant(show, picture, params.size_px != shown_px);
        let pipeline = self.pipelines.get(&self.gpu, &self.cache, &self.variant, variant)?;
        let bindings = present::Bindings {
            colors: &frame.colors,
            depths: &frame.depths,
            surfaces: picture.surfaces.map_or(&self.no_surfaces, |s| &s.by_pixel),
            looks: &self.looks.0,
            counters: &frame.scratch.counters,
            pixels: &mut self.pixels,
            tile_ranges: &frame.tile_ranges,
            instances: &picture.scene.instances,
            offset_means: &picture.scene.parameters.offset_means,
            packed_offset_means: &picture.scene.packed.offsets[0],
            offset_ranges: &picture.scene.packed.offset_ranges,
            marks: picture.marks.map_or(&self.no_marks, |m| &m.by_pixel),
        };
        let grid = Grid::threads(shown_px[0] * shown_px[1], self.variant.workgroup_size);
        Ok(recorder.dispatch(pipeline, grid, &params, bindings)?)
    }

    /// The variant to compile the kernel for; a view without its inputs shows black.
    fn present_variant(&self, show: Show, picture: ShownPicture<'_>, scaled: bool) -> PresentVariant {
        let surfaces = picture.surfaces.is_some() || !show.needs_surfaces();
        let marks = picture.marks.is_some() || show.marks().is_none();
        let chosen = self.looks.1.iter().any(|look| look & 1 != 0);
        PresentVariant {
            show: if surfaces && marks { show.code().0 } else { SHOW_NOTHING },
            outline: chosen && picture.surfaces.is_some(),
            scaled,
            precision: picture.scene.precision,
        }
    }

    /// The push constants that do not depend on the window.
    fn params(&self, show: Show, picture: ShownPicture<'_>) -> present::Params {
        let size_px = picture.renderer.frame().map_or([1, 1], |frame| frame.plan.size_px);
        present::Params {
            size_px,
            range: show.code().1,
            instance_count: (self.looks.1.len() as u32).min(picture.scene.posed_instances()),
            posed_rows: picture.scene.posed_rows(),
            offset_count: picture.scene.counts.rows[Parameter::OffsetMeans][0] as u32,
            tile_size: tile_size_for(&self.gpu, picture.renderer.variant(), size_px),
            ..present::Params::default()
        }
    }

    /// Makes the next recording start from black: the last one is not submitted.
    pub(super) fn forget_pixels(&mut self) {
        self.shown_px = [0; 2];
    }

    /// The pixels of the last recording: one u32 each, row by row from the top.
    pub fn pixels(&self) -> &Buffer<u32> {
        &self.pixels
    }

    /// Downloads the pixels as bytes red, green, blue. They must have been recorded with red first, and submitted.
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
