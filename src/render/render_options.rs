//! Settings of a picture besides the camera, and the two together as kernels take them.

use crate::gpu::interface::types;
use crate::scene::{Camera, DevicePrecision, InstancedScene, NearPlane, PixelFilter};

use super::error::RenderError;

/// Settings of a picture besides the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// Splats with view depth <= near are not drawn; scene units.
    pub near: f32,
    /// Added to the projected variances, px^2.
    pub dilation_px2: f32,
    /// Compensates opacity for the dilation.
    pub antialias: bool,
    /// Background colour, rgb in the encoding of the training images.
    pub background: [f32; 3],
    /// Levels of detail: instances and parts of the background are drawn merged where the merged cells are at most this
    /// wide, pixels ([`crate::scene::lod`]); 0 = everything at full detail. Above 0 it needs a scene that was uploaded
    /// with levels ([`Renderer::upload_for`](super::Renderer::upload_for)).
    pub lod_error_px: f32,
    /// How the device holds scenes that are uploaded with these options
    /// ([`Renderer::upload_for`](super::Renderer::upload_for)).
    pub device_precision: DevicePrecision,
    /// Draws in depth layers, front to back, and does not expand what lies behind tiles that are closed. The picture has the
    /// same bytes; it takes less time and memory where the front of a scene hides much, and more where it hides little.
    /// Pictures with other passes than the blend are drawn without.
    pub occlusion: bool,
    /// Limits the buffers of visible chunks; frames that need more are drawn in several depth ranges, if they have no other
    /// passes than the blend. `None` = the device's limit.
    pub max_chunks: Option<u32>,
    /// Frames that device memory, or its budget, is too small for are drawn in depth ranges, if they have no other passes
    /// than the blend, with as small buffers as it takes, and scenes that take most of it stay in host memory; else they are an
    /// error.
    pub divide_for_memory: bool,
    /// Limits the intersection buffer; frames that need more are blended in depth slabs. `None` = the device's limit.
    pub max_intersections: Option<u32>,
}

impl Default for RenderOptions {
    /// The INRIA constants: near 0.2, dilation 0.3, black background; everything at full detail, in f32.
    fn default() -> Self {
        Self {
            near: NearPlane::default().0,
            dilation_px2: 0.3,
            antialias: false,
            background: [0.0; 3],
            lod_error_px: 0.0,
            device_precision: DevicePrecision::F32,
            occlusion: false,
            max_chunks: None,
            divide_for_memory: false,
            max_intersections: None,
        }
    }
}

impl RenderOptions {
    /// How a scene is drawn if nothing else is asked for: with the near plane and the pixel filter that it was trained with.
    pub fn of(scene: &InstancedScene) -> Self {
        Self { near: scene.near_plane.0, ..Self::default() }.filtered(scene.pixel_filter)
    }

    /// The same with another pixel filter.
    #[must_use]
    pub fn filtered(self, filter: PixelFilter) -> Self {
        Self { dilation_px2: filter.dilation_px2, antialias: filter.antialias, ..self }
    }

    /// Fails with the first option that is out of range.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        let fail = |option, reason: String| Err(RenderError::Option { option, reason });
        if !NearPlane(self.near).is_valid() {
            return fail("near", format!("{} is not a finite number >= 0", self.near));
        }
        // The projected variance must not vanish: 1e-6 px^2 is a thousandth of a pixel.
        if !(self.dilation_px2.is_finite() && (1e-6..=1e6).contains(&self.dilation_px2)) {
            return fail("dilation", format!("{} is not within 1e-6..=1e6", self.dilation_px2));
        }
        if !(self.lod_error_px.is_finite() && self.lod_error_px >= 0.0) {
            return fail("lod", format!("{} is not a finite number of pixels >= 0", self.lod_error_px));
        }
        if !self.background.iter().all(|c| c.is_finite()) {
            return fail("background", "is not finite".into());
        }
        Ok(())
    }
}

/// The camera as the kernels see it, rounded to f32.
pub fn view_of(camera: &Camera, options: &RenderOptions) -> types::View {
    let m = &camera.view_from_world;
    let row = |i: usize| m[i].map(|v| v as f32);
    types::View {
        view_from_world: [row(0), row(1), row(2)],
        position_world: camera.position_world().as_vec3().to_array(),
        near: options.near,
        focal_px: [camera.fx as f32, camera.fy as f32],
        principal_px: [camera.cx as f32, camera.cy as f32],
        size_px: [camera.width, camera.height],
        dilation_px2: options.dilation_px2,
        antialias: u32::from(options.antialias),
    }
}
