//! Parameters back from the device.

use std::ops::Range;
use std::sync::Arc;

use crate::gpu::Gpu;
use crate::gpu::interface::types;
use crate::gpu::staging::download;
use crate::math::similarity::{Similarity, SimilarityError};
use crate::scene::gaussians::sh_coefficients;
use crate::scene::instanced_scene::{Instance, SceneError};
use crate::scene::{Gaussians, InstancedScene, Offsets};

use super::device_scene::DeviceScene;
use super::error::RenderError;

impl DeviceScene {
    /// The scene as it is on the device; templates and offsets of instances, ranges, names and what else the device does
    /// not hold are those of `like`, the scene that was uploaded. Counts and SH degrees are the device's: they may differ
    /// from `like`'s.
    ///
    /// # Errors
    /// The device failed, or an instance's transform is no similarity any more.
    pub fn download(&self, gpu: &Arc<Gpu>, like: &InstancedScene) -> Result<InstancedScene, RenderError> {
        let counts = self.counts;
        let all = counts.templates + counts.background;
        let means = download(gpu, &self.means, all)?;
        let quats = download(gpu, &self.quats, all)?;
        let log_scales = download(gpu, &self.log_scales, all)?;
        let opacity_logits = download(gpu, &self.opacity_logits, all)?;
        let mut bands = Vec::new();
        for band in &self.sh_bands {
            bands.push(download(gpu, band, band.len())?);
        }
        let cloud = |run: Range<usize>, sh_degree: u32, first_in_band: [usize; 4]| Gaussians {
            sh_degree,
            means: means[run.clone()].to_vec(),
            quats: quats[run.clone()].to_vec(),
            log_scales: log_scales[run.clone()].to_vec(),
            opacity_logits: opacity_logits[run.clone()].to_vec(),
            sh: sh_of_bands(&bands, run.len(), sh_degree, first_in_band),
        };
        let above = |l: u32| if counts.template_sh_degree >= l { counts.templates } else { 0 };
        Ok(InstancedScene {
            templates: cloud(0..counts.templates, counts.template_sh_degree, [0; 4]),
            background: cloud(counts.templates..all, counts.background_sh_degree, [0, 1, 2, 3].map(above)),
            instances: self.download_instances(gpu, &like.instances)?,
            offsets: Offsets {
                means: download(gpu, &self.offset_means, counts.offsets)?,
                sh_dc: download(gpu, &self.offset_sh_dc, counts.offsets)?,
                opacity_logits: download(gpu, &self.offset_opacity_logits, counts.offsets)?,
                sh_rest: download(gpu, &self.offset_sh_rest, counts.offset_sh_rest)?,
                log_scales: download(gpu, &self.offset_log_scales, counts.offset_log_scales)?,
                quats: download(gpu, &self.offset_quats, counts.offset_quats)?,
            },
            ..like.clone()
        })
    }

    /// `like`, with the transforms of the device.
    fn download_instances(&self, gpu: &Arc<Gpu>, like: &[Instance]) -> Result<Vec<Instance>, RenderError> {
        let on_device = download(gpu, &self.instances, like.len())?;
        let current = |(k, (like, now)): (usize, (&Instance, types::Instance))| {
            let transform = Similarity::from_rows(now.world_from_template);
            let error = |reason: SimilarityError| SceneError {
                tensor: "instance.world_from_template".into(),
                reason: format!("instance {k} {reason}"),
            };
            Ok(Instance { world_from_template: transform.map_err(error)?, ..like.clone() })
        };
        like.iter().zip(on_device).enumerate().map(current).collect()
    }
}

/// From bands to coefficients by Gaussian.
fn sh_of_bands(bands: &[Vec<[f32; 3]>], len: usize, sh_degree: u32, first_in_band: [usize; 4]) -> Vec<[f32; 3]> {
    let mut sh = Vec::with_capacity(len * sh_coefficients(sh_degree));
    for i in 0..len {
        for l in 0..=sh_degree as usize {
            let width = 2 * l + 1;
            let first = (first_in_band[l] + i) * width;
            sh.extend_from_slice(&bands[l][first..first + width]);
        }
    }
    sh
}
