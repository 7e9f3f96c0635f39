//! How a scene is drawn: the keyword arguments that pictures and evaluation share.

use instgs_vk::render::RenderOptions;
use instgs_vk::scene::{InstancedScene, PixelFilterChoice};

/// The values given; `None` takes the scene's or the default, as the command line does.
#[derive(Clone, Copy, Default)]
pub(crate) struct Look {
    /// Background colour, rgb in 0..=1.
    pub(crate) background: Option<[f32; 3]>,
    /// Depth of the near plane, scene units.
    pub(crate) near: Option<f32>,
    /// Whether opacities make up for the dilation.
    pub(crate) antialias: Option<bool>,
    /// Added to projected variances, px^2.
    pub(crate) dilation: Option<f32>,
    /// Largest width of merged cells, pixels.
    pub(crate) lod: Option<f32>,
}

impl Look {
    /// The options for a scene.
    pub(crate) fn options(&self, scene: &InstancedScene) -> RenderOptions {
        let default = RenderOptions::default();
        let filter = PixelFilterChoice { dilation_px2: self.dilation, antialias: self.antialias };
        RenderOptions {
            near: self.near.unwrap_or(scene.near_plane.0),
            background: self.background.unwrap_or(default.background),
            lod_error_px: self.lod.unwrap_or(default.lod_error_px),
            // The same picture, also of a scene that is large for the device.
            divide_for_memory: true,
            ..default
        }
        .filtered(filter.over(scene.pixel_filter))
    }
}
