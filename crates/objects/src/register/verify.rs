//! Compares poses by pictures: the reference's Gaussians, moved onto the target, are rendered into the views that show
//! the target best, and compared with the target there.
//!
//! The target's picture is the photo inside its mask, if photos are given; else a rendering of its own Gaussians alone.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::check::{Agreement, PoseCheck};
use super::compare::{Seen, agreement};
use super::error::RegisterError;
use super::outline::{Crop, best_crops};
use instgs_io::masks::Mask;
use instgs_io::view_image::ViewImage;
use instgs_vk::gpu::Gpu;
use instgs_vk::math::sh::widened;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{DeviceScene, Picture, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, Gaussians, Instance, InstancedScene, SourceRange};

/// Number of Gaussians that stand for the object's outline: enough to find its box.
const OUTLINE_POINTS: usize = 300;

/// Gives a view's photo and mask, both of the camera's size, by its index; `None` if the view has none.
pub type PhotoOfView<'a> = dyn FnMut(usize) -> Result<Option<(ViewImage, Mask)>, RegisterError> + 'a;

/// A [`PoseCheck`] that uses the renderer.
pub struct RenderCheck<'a> {
    renderer: Renderer,
    cloud: &'a Gaussians,
    cameras: &'a [Camera],
    options: RenderOptions,
    photo_of_view: Option<Box<PhotoOfView<'a>>>,
    /// Indices of finite Gaussians by mask id.
    indices: BTreeMap<u32, Vec<u32>>,
}

impl<'a> RenderCheck<'a> {
    /// `cloud` is a plain cloud with one label per Gaussian, and `options` are those it was trained with. Photos are
    /// requested by the index of the camera.
    ///
    /// # Errors
    /// A device that cannot render.
    pub fn new(
        gpu: &Arc<Gpu>,
        cloud: &'a Gaussians,
        instance_of_gaussian: &[u32],
        cameras: &'a [Camera],
        options: RenderOptions,
        photo_of_view: Option<Box<PhotoOfView<'a>>>,
    ) -> Result<Self, RegisterError> {
        let mut indices: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (i, &id) in instance_of_gaussian.iter().enumerate().take(cloud.len()) {
            if id != 0 && cloud.is_finite(i) {
                indices.entry(id).or_default().push(i as u32);
            }
        }
        // Colours are compared before blending with a background, so it must be black.
        let options = RenderOptions { background: [0.0; 3], ..options };
        Ok(Self { renderer: Renderer::new(gpu)?, cloud, cameras, options, photo_of_view, indices })
    }

    /// The Gaussians of one object, moved by `pose`.
    fn scene(&self, id: u32, pose: Similarity) -> Result<DeviceScene, RegisterError> {
        let mut templates = Gaussians::with_capacity(self.cloud.sh_degree, 0);
        self.indices.get(&id).into_iter().flatten().for_each(|&i| templates.push_from(self.cloud, i as usize));
        let scene = InstancedScene {
            template_ranges: vec![SourceRange { first: 0, count: templates.len() as u32 }],
            instances: vec![Instance { template: 0, world_from_template: pose, first_offset: None }],
            background: Gaussians::with_capacity(self.cloud.sh_degree, 0),
            templates,
            ..InstancedScene::default()
        };
        Ok(self.renderer.upload(&scene)?)
    }

    fn pictures(&mut self, id: u32, pose: Similarity, crops: &[Crop]) -> Result<Vec<Picture>, RegisterError> {
        let scene = self.scene(id, pose)?;
        let mut out = Vec::with_capacity(crops.len());
        for crop in crops {
            let failed = |error| RegisterError::View { view: crop.camera.name.clone(), error };
            self.renderer.render(&scene, &crop.camera, &self.options).map_err(failed)?;
            out.push(self.renderer.download()?);
        }
        Ok(out)
    }

    /// Pictures of the target in the crops.
    fn seen(&mut self, target: u32, crops: &[Crop]) -> Result<Vec<Seen>, RegisterError> {
        let own = self.pictures(target, Similarity::IDENTITY, crops)?;
        let mut out = Vec::with_capacity(crops.len());
        for (crop, own) in crops.iter().zip(own) {
            let photo = match &mut self.photo_of_view {
                Some(photo_of_view) => photo_of_view(crop.view)?,
                None => None,
            };
            let seen = photo.and_then(|(photo, mask)| Seen::in_photo(crop, &photo, &mask, target));
            out.push(seen.unwrap_or_else(|| Seen::in_render(&own)));
        }
        Ok(out)
    }
}

impl PoseCheck for RenderCheck<'_> {
    fn check(
        &mut self,
        reference: u32,
        target: u32,
        target_from_reference: &[Similarity],
    ) -> Result<Option<Vec<Agreement>>, RegisterError> {
        let Some(own) = self.indices.get(&target) else { return Ok(None) };
        let step = own.len().div_ceil(OUTLINE_POINTS).max(1);
        let points: Vec<_> = own.iter().step_by(step).map(|&i| widened(self.cloud.means[i as usize])).collect();
        let crops = best_crops(self.cameras, &points);
        if crops.is_empty() {
            return Ok(None);
        }
        let seen = self.seen(target, &crops)?;
        let mut out = Vec::with_capacity(target_from_reference.len());
        for &pose in target_from_reference {
            out.push(agreement(&seen, &self.pictures(reference, pose, &crops)?));
        }
        Ok(Some(out))
    }
}
