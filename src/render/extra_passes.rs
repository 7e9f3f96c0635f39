//! Optional passes over a picture besides its colours. They read the same lists as the blend and are recorded after it
//! into the same command buffer, so a picture with them is submitted, and waited for, like one without.

use crate::gpu::{GpuError, Grid, PipelineCache, Recorder};
use crate::kernels::Variant;
use crate::scene::Camera;

use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::forward::ForwardInputs;
use super::frame_buffers::FrameBuffers;
use super::frame_stats::FrameStats;
use super::marks::{MarkShape, Marks};
use super::plan::FramePlan;
use super::render_options::RenderOptions;
use super::renderer::{EachSlab, Renderer};
use super::surfaces::Surfaces;

/// The optional passes of a frame; none by default.
#[derive(Default)]
pub struct ExtraPasses<'a> {
    /// Id buffer: the Gaussian at the surface of every pixel.
    pub surfaces: Option<&'a mut Surfaces>,
    /// Marks on single splats, in this shape.
    pub marks: Option<(&'a mut Marks, MarkShape)>,
}

impl ExtraPasses<'_> {
    /// True if there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.surfaces.is_none() && self.marks.is_none()
    }

    /// Recreates pipelines and buffers that do not fit the picture.
    pub(super) fn prepare(
        &mut self,
        cache: &PipelineCache,
        variant: Variant,
        plan: &FramePlan,
    ) -> Result<(), RenderError> {
        if let Some((marks, _)) = &mut self.marks {
            marks.prepare(cache, variant, plan)?;
        }
        self.surfaces.as_mut().map_or(Ok(()), |surfaces| surfaces.prepare(cache, variant, plan))
    }

    /// Records the passes of a slab, after its blend.
    pub(super) fn record(
        &mut self,
        recorder: &mut Recorder,
        inputs: &ForwardInputs<'_>,
        frame: &FrameBuffers,
    ) -> Result<(), GpuError> {
        if let Some((marks, shape)) = &mut self.marks {
            marks.record(recorder, inputs, frame, *shape)?;
        }
        self.surfaces.as_mut().map_or(Ok(()), |surfaces| surfaces.record(recorder, inputs, frame))
    }
}

/// Grid of one subgroup per 8x8 block of every tile.
pub(super) fn block_grid(plan: &FramePlan, variant: &Variant) -> Grid {
    let blocks = plan.tile_count() * variant.blocks_per_tile();
    Grid::groups(blocks.div_ceil(variant.blend_workgroup_size / variant.subgroup_size))
}

impl Renderer {
    /// The same as [`Renderer::render`], with optional passes.
    ///
    /// # Errors
    /// The same errors as [`Renderer::render`].
    pub fn render_with(
        &mut self,
        scene: &DeviceScene,
        camera: &Camera,
        options: &RenderOptions,
        extra: ExtraPasses<'_>,
    ) -> Result<FrameStats, RenderError> {
        self.slabs(scene, camera, options, EachSlab::Blend(extra))
    }
}
