//! Downloads parameters and poses from the device.

use std::sync::Arc;

use crate::gpu::Gpu;
use crate::gpu::staging::download;
use crate::math::similarity::{Similarity, SimilarityError};
use crate::scene::InstancedScene;
use crate::scene::instanced_scene::{Instance, SceneError};

use super::device_scene::DeviceScene;
use super::error::RenderError;

impl DeviceScene {
    /// Downloads the scene. Ranges, names and everything else that is not on the device come from `like`, the scene
    /// that was uploaded, and so does the number of instances' own Gaussians. The other counts and SH degrees are the
    /// device's and may differ from those of `like`.
    ///
    /// # Errors
    /// A Vulkan call failed, or an instance's transform is no longer a similarity.
    pub fn download(&self, gpu: &Arc<Gpu>, like: &InstancedScene) -> Result<InstancedScene, RenderError> {
        let counts = self.counts;
        let mut scene = InstancedScene { instances: self.download_instances(gpu, &like.instances)?, ..like.clone() };
        scene.templates.set_sh_degree(counts.template_sh_degree);
        if !scene.own.is_empty() {
            scene.own.set_sh_degree(counts.template_sh_degree);
        }
        scene.background.set_sh_degree(counts.background_sh_degree);
        self.parameters.download(gpu, &counts.rows, &mut scene)?;
        Ok(scene)
    }

    /// The instances `like` with the transforms of the device.
    fn download_instances(&self, gpu: &Arc<Gpu>, like: &[Instance]) -> Result<Vec<Instance>, RenderError> {
        self.write_changes(gpu)?;
        let rows = download(gpu, &self.instances, self.posed_rows() as usize)?;
        let current = |(k, like): (usize, &Instance)| {
            let transform = Similarity::from_rows(rows[self.rows_of(k).start].world_from_template);
            let error = |reason: SimilarityError| SceneError {
                tensor: "instance.world_from_template".into(),
                reason: format!("instance {k} {reason}"),
            };
            Ok(Instance { world_from_template: transform.map_err(error)?, ..like.clone() })
        };
        like.iter().enumerate().map(current).collect()
    }
}
