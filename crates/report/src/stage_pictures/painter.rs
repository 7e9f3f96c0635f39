//! Renders clouds that exist only for a picture.

use std::sync::Arc;

use crate::Rgb8;
use instgs_vk::gpu::Gpu;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{Picture, RenderError, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, Gaussians, Instance, InstancedScene, SourceRange};

/// Background of single objects, grey from 0 to 1: light, so that dark objects have a clear outline.
pub(super) const GROUND: f32 = 0.93;

/// A renderer with its options.
pub struct Painter {
    renderer: Renderer,
    options: RenderOptions,
}

impl Painter {
    /// A painter with the `options` that the cloud was trained with; their background colour is behind all splats.
    ///
    /// # Errors
    /// The device refuses a kernel or a buffer.
    pub fn new(gpu: &Arc<Gpu>, options: RenderOptions) -> Result<Self, RenderError> {
        Ok(Self { renderer: Renderer::new(gpu)?, options })
    }

    /// Renders the cloud, moved by `pose`, from each camera.
    pub(super) fn pictures(
        &mut self,
        cloud: Gaussians,
        pose: Similarity,
        cameras: &[Camera],
    ) -> Result<Vec<Picture>, RenderError> {
        let scene = InstancedScene {
            template_ranges: vec![SourceRange { first: 0, count: cloud.len() as u32 }],
            instances: vec![Instance { template: 0, world_from_template: pose, first_offset: None }],
            background: Gaussians::with_capacity(cloud.sh_degree, 0),
            templates: cloud,
            ..InstancedScene::default()
        };
        let scene = self.renderer.upload(&scene)?;
        let mut out = Vec::with_capacity(cameras.len());
        for camera in cameras {
            self.renderer.render(&scene, camera, &self.options)?;
            out.push(self.renderer.download()?);
        }
        Ok(out)
    }
}

/// Converts a picture over its background to 8 bits per channel.
pub(super) fn rgb8(picture: &Picture) -> Rgb8 {
    Rgb8 { width: picture.width, height: picture.height, pixels: picture.rgb8() }
}
