//! Exposures of training photos. Cameras brighten, darken and tint single photos; an affine map of the colours for each
//! photo, learned with the scene, keeps that out of the Gaussians. A scene is rendered without it.

use std::sync::Arc;

use crate::gpu::interface::constants::{EXPOSURE_PIXELS, EXPOSURE_ROWS, EXPOSURE_VALUES};
use crate::gpu::staging::{download, upload, write};
use crate::gpu::{Buffer, Gpu, GpuError, Grid, PipelineCache, Recorder};
use crate::kernels::{
    ExposurePipelines, Variant, apply_exposure, exposure_backward, recentre_exposures, refine_exposure,
};

use super::adam::{Adam, MomentBuffer, zero_moments};

/// The exposure of a photo: rows (M_r, b_r) of the map M rgb + b from the scene's colours to the photo's.
pub type Exposure = [[f32; 4]; 3];

/// The exposure that changes nothing.
pub const NO_EXPOSURE: Exposure = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// The exposures of all training photos on the device, and the passes that apply and learn them.
pub struct Exposures {
    pipelines: ExposurePipelines,
    variant: Variant,
    views: usize,
    /// Three rows for each view.
    rows: Buffer<[f32; 4]>,
    moments: MomentBuffer,
    /// The picture of the step with its exposure.
    exposed: Buffer<[f32; 4]>,
    /// Gradients by the rows of the view of the step, by subgroup of `exposure_backward`.
    sums: Buffer<[f32; 4]>,
}

/// The view of a step, as the passes of its exposure see it.
#[derive(Clone, Copy, Debug)]
pub struct ExposedView {
    /// Index of the training view.
    pub view: usize,
    /// Width and height of its picture, pixels.
    pub size_px: [u32; 2],
    /// The colour behind the scene, which exposures leave as it is.
    pub background: [f32; 3],
}

/// A step of Adam on the exposure of a view.
#[derive(Clone, Copy, Debug)]
pub struct ExposureStep {
    /// Adam's constants; its step counts those of this view alone, from 1.
    pub adam: Adam,
    /// Learning rate, colour units.
    pub rate: f64,
}

impl ExposedView {
    fn pixels(self) -> u32 {
        self.size_px[0] * self.size_px[1]
    }
}

impl Exposures {
    /// Exposures that change nothing, for `views` photos of at most `largest_px` (width, height).
    ///
    /// # Errors
    /// The device's memory is full, or a kernel does not compile.
    pub fn new(
        gpu: &Arc<Gpu>,
        cache: &PipelineCache,
        variant: &Variant,
        views: usize,
        largest_px: [u32; 2],
    ) -> Result<Self, GpuError> {
        let pixels = largest_px[0] * largest_px[1];
        let rows = vec![NO_EXPOSURE; views];
        let sums = (EXPOSURE_ROWS * sums_of(variant, pixels)) as usize;
        Ok(Self {
            pipelines: ExposurePipelines::new(gpu, cache, variant)?,
            variant: *variant,
            views,
            rows: upload(gpu, "exposures", rows.as_flattened())?,
            moments: zero_moments(gpu, "moments, exposures", EXPOSURE_VALUES as usize * views)?,
            exposed: Buffer::new(gpu, "exposed colors", pixels as usize)?,
            sums: Buffer::new(gpu, "exposure sums", sums)?,
        })
    }

    /// Number of photos.
    pub fn views(&self) -> usize {
        self.views
    }

    /// The picture that [`Exposures::record_apply`] leaves.
    pub fn exposed(&self) -> &Buffer<[f32; 4]> {
        &self.exposed
    }

    /// Size of all buffers, bytes.
    pub fn bytes(&self) -> u64 {
        self.rows.bytes() + self.moments.bytes() + self.exposed.bytes() + self.sums.bytes()
    }

    /// The flat buffers that training changes, for checkpoints: rows of exposures, 12 numbers a view, and moments, 24.
    pub fn state(&mut self) -> [(&mut Buffer<f32>, usize); 2] {
        let values = EXPOSURE_VALUES as usize;
        [(self.rows.scalars_mut(), values), (self.moments.scalars_mut(), 2 * values)]
    }

    /// Replaces the exposures; their moments stay.
    ///
    /// # Panics
    /// There is not one exposure for each photo.
    pub fn set(&mut self, gpu: &Arc<Gpu>, exposures: &[Exposure]) -> Result<(), GpuError> {
        assert_eq!(exposures.len(), self.views, "one exposure for each photo");
        write(gpu, &mut self.rows, exposures.as_flattened())
    }

    /// The exposures of all photos. Waits for everything submitted before.
    pub fn download(&self, gpu: &Arc<Gpu>) -> Result<Vec<Exposure>, GpuError> {
        let rows = download(gpu, &self.rows, EXPOSURE_ROWS as usize * self.views)?;
        Ok(rows.as_chunks().0.to_vec())
    }

    /// Records the exposure of `colors`, the picture of the view.
    pub fn record_apply(
        &mut self,
        recorder: &mut Recorder,
        view: ExposedView,
        colors: &Buffer<[f32; 4]>,
    ) -> Result<(), GpuError> {
        let params =
            apply_exposure::Params { pixels: view.pixels(), view: view.view as u32, background: view.background };
        let bindings = apply_exposure::Bindings { colors, exposures: &self.rows, exposed_colors: &mut self.exposed };
        let grid = Grid::threads(view.pixels(), self.variant.workgroup_size);
        recorder.dispatch(&self.pipelines.apply_exposure, grid, &params, bindings)
    }

    /// Records the way back: `cotangents` by the exposed colours become those by `colors`, and the gradient by the
    /// exposure is kept for [`Exposures::record_adam`].
    pub fn record_backward(
        &mut self,
        recorder: &mut Recorder,
        view: ExposedView,
        colors: &Buffer<[f32; 4]>,
        cotangents: &mut Buffer<[f32; 4]>,
    ) -> Result<(), GpuError> {
        let params =
            exposure_backward::Params { pixels: view.pixels(), view: view.view as u32, background: view.background };
        let bindings =
            exposure_backward::Bindings { colors, exposures: &self.rows, cotangents, exposure_sums: &mut self.sums };
        let grid = Grid::groups(groups_of(&self.variant, view.pixels()));
        recorder.dispatch(&self.pipelines.exposure_backward, grid, &params, bindings)
    }

    /// Records the step of the exposure of a view. The device skips it if `status` holds an overflow.
    pub fn record_adam(
        &mut self,
        recorder: &mut Recorder,
        view: ExposedView,
        step: ExposureStep,
        status: &Buffer<u32>,
    ) -> Result<(), GpuError> {
        let ExposureStep { adam, rate } = step;
        let params = refine_exposure::Params {
            view: view.view as u32,
            sums: sums_of(&self.variant, view.pixels()),
            rate: adam.corrected(rate),
            beta1: adam.beta1 as f32,
            beta2: adam.beta2 as f32,
            second_scale: adam.second_scale(),
            epsilon: adam.epsilon as f32,
        };
        let bindings = refine_exposure::Bindings {
            exposure_sums: &self.sums,
            status,
            exposures: self.rows.scalars_mut(),
            exposure_moments: &mut self.moments,
        };
        recorder.dispatch(&self.pipelines.refine_exposure, Grid::groups(1), &params, bindings)
    }

    /// Records that the mean of all exposures becomes the identity: what all photos have in common is the scene's. The device
    /// skips it if `status` holds an overflow.
    pub fn record_recentre(&mut self, recorder: &mut Recorder, status: &Buffer<u32>) -> Result<(), GpuError> {
        let params = recentre_exposures::Params { views: self.views as u32 };
        let bindings = recentre_exposures::Bindings { status, exposures: self.rows.scalars_mut() };
        recorder.dispatch(&self.pipelines.recentre_exposures, Grid::groups(1), &params, bindings)
    }
}

/// Work-groups of `exposure_backward`.
fn groups_of(variant: &Variant, pixels: u32) -> u32 {
    pixels.div_ceil(variant.workgroup_size * EXPOSURE_PIXELS)
}

/// Entries of the sums of `exposure_backward`, three rows each.
fn sums_of(variant: &Variant, pixels: u32) -> u32 {
    groups_of(variant, pixels) * (variant.workgroup_size / variant.subgroup_size)
}
