//! Parameters back from the device.

use std::sync::Arc;

use crate::gpu::staging::download;
use crate::gpu::{Gpu, GpuError};
use crate::scene::gaussians::sh_coefficients;
use crate::scene::{Gaussians, InstancedScene, Offsets};

use super::device_scene::DeviceScene;

impl DeviceScene {
    /// The scene with the parameters as they are on the device; everything else as in `layout`, the scene that was uploaded
    /// (or one of the same counts, SH degrees and ranges).
    pub fn download(&self, gpu: &Arc<Gpu>, layout: &InstancedScene) -> Result<InstancedScene, GpuError> {
        let (templates, background) = (layout.templates.len(), layout.background.len());
        let all = templates + background;
        let means = download(gpu, &self.means, all)?;
        let quats = download(gpu, &self.quats, all)?;
        let log_scales = download(gpu, &self.log_scales, all)?;
        let opacity_logits = download(gpu, &self.opacity_logits, all)?;
        let mut bands = Vec::new();
        for band in &self.sh_bands {
            bands.push(download(gpu, band, band.len())?);
        }
        let cloud = |like: &Gaussians, first: usize, first_in_band: [usize; 4]| {
            let run = first..first + like.len();
            Gaussians {
                sh_degree: like.sh_degree,
                means: means[run.clone()].to_vec(),
                quats: quats[run.clone()].to_vec(),
                log_scales: log_scales[run.clone()].to_vec(),
                opacity_logits: opacity_logits[run].to_vec(),
                sh: sh_of_bands(&bands, like, first_in_band),
            }
        };
        let above = |l: u32| if layout.templates.sh_degree >= l { templates } else { 0 };
        let offsets = layout.offsets.len();
        Ok(InstancedScene {
            templates: cloud(&layout.templates, 0, [0; 4]),
            background: cloud(&layout.background, templates, [0, 1, 2, 3].map(above)),
            offsets: Offsets {
                means: download(gpu, &self.offset_means, offsets)?,
                sh_dc: download(gpu, &self.offset_sh_dc, offsets)?,
                opacity_logits: download(gpu, &self.offset_opacity_logits, offsets)?,
            },
            ..layout.clone()
        })
    }
}

/// From bands to coefficients by Gaussian.
fn sh_of_bands(bands: &[Vec<[f32; 3]>], like: &Gaussians, first_in_band: [usize; 4]) -> Vec<[f32; 3]> {
    let mut sh = Vec::with_capacity(like.len() * sh_coefficients(like.sh_degree));
    for i in 0..like.len() {
        for l in 0..=like.sh_degree as usize {
            let width = 2 * l + 1;
            let first = (first_in_band[l] + i) * width;
            sh.extend_from_slice(&bands[l][first..first + width]);
        }
    }
    sh
}
