//! Measures quality, size and speed of an instanced scene, and of plain clouds with the same training time or the same
//! number of bytes. The protocol is in `docs/design.md`; `comparison` trains the scenes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use instgs_eval::{EvalError, Evaluated, Extras, Lpips, PairError, PicturePair, evaluate, psnr};
use instgs_io::{IoError, MaskFolder, View, load_scene};
use instgs_train::config::TrainConfig;
use instgs_vk::gpu::Gpu;
use instgs_vk::math::digits::grouped;
use instgs_vk::render::{RenderError, RenderOptions, Renderer};
use instgs_vk::scene::RepeatedBytes;

/// Names of the rows of a comparison.
pub mod names {
    /// The plain cloud from which the instanced scene is made.
    pub const START: &str = "3DGS, the start";
    /// The same cloud, trained on for as long as the instanced scene took.
    pub const SAME_TIME: &str = "3DGS, same time";
    /// A plain cloud trained for the same number of steps in one run, so that its learning rates decay once.
    pub const AT_ONCE: &str = "3DGS, same time at once";
    /// A plain cloud of as many steps as [`SAME_TIME`], whose f16 file is at most as large as that of [`OURS_F16`].
    pub const SAME_BYTES: &str = "3DGS, same bytes";
    /// The same number of Gaussians, placed by 3DGS-MCMC.
    pub const MCMC: &str = "3DGS-MCMC, same time";
    /// [`SAME_TIME`], quantised per Gaussian to .spz.
    pub const SPZ: &str = "3DGS, same time, .spz";
    /// [`SAME_TIME`], packed like [`OURS_SMALL`].
    pub const SAME_TIME_SMALL: &str = "3DGS, same time, small";
    /// Templates and poses without offsets: every instance looks the same.
    pub const RIGID: &str = "rigid copies";
    /// The instanced scene as trained.
    pub const OURS: &str = "InstGS";
    /// The instanced scene with half floats.
    pub const OURS_F16: &str = "InstGS, f16";
    /// The instanced scene with offsets of 8 bits.
    pub const OURS_Q8: &str = "InstGS, q8";
    /// The instanced scene with offsets of 8 bits, and the rest quantised and compressed.
    pub const OURS_SMALL: &str = "InstGS, small";
}

/// All rows for one data set and one seed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeedResult {
    /// Seed of all trainings.
    pub seed: u64,
    /// One row per scene; see [`names`].
    pub rows: Vec<Row>,
    /// Frames per second of the instanced scene and of [`names::SAME_TIME`], measured in turn.
    pub fps: Option<[f64; 2]>,
    /// (splat, tile) pairs of the same two scenes, mean over the views.
    pub intersections: Option<[u64; 2]>,
    /// Milliseconds per frame of each pass, for the same two scenes.
    pub passes_ms: Vec<(String, f64, f64)>,
    /// Sizes of the repeated part of the scene.
    pub repeated: RepeatedBytes,
    /// Bytes as .ply of those Gaussians of the plain cloud that became instances, without those dropped as hardly
    /// visible. Less than `repeated.ply` where templates have more Gaussians than an object had.
    #[serde(default)]
    pub replaced_ply: u64,
    /// Steps for which the plain cloud would have been trained on by wall time, at the pace of its last steps.
    #[serde(default)]
    pub more_steps_by_clock: u64,
    /// Warnings about groups and objects, for the user.
    pub warnings: Vec<String>,
}

impl SeedResult {
    /// The row with the given name.
    pub fn row(&self, name: &str) -> Option<&Row> {
        self.rows.iter().find(|row| row.name == name)
    }
}

/// The most Gaussians that a comparison's scenes may draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct DrawLimits {
    /// Of plain clouds: `max_gaussians`.
    pub plain: u32,
    /// Of instanced scenes, expanded: `max_gaussians` times `joint.max_expanded`.
    pub instanced: u32,
}

impl DrawLimits {
    /// The limits of runs with this configuration.
    pub(crate) fn of(config: &TrainConfig) -> Self {
        Self { plain: config.max_gaussians, instanced: config.joint_phase().max_gaussians }
    }

    /// A sentence about what each may draw; `None` if instanced scenes may draw no more than plain ones.
    pub(crate) fn text(self) -> Option<String> {
        let Self { plain, instanced } = self;
        (instanced > plain).then(|| {
            format!(
                "InstGS may draw up to {} Gaussians (max_gaussians times joint.max_expanded), its rivals up to {} \
                 (max_gaussians; those of the same bytes as many as fit)",
                grouped(u64::from(instanced)),
                grouped(u64::from(plain))
            )
        })
    }
}

/// One scene of a comparison, with its measurements.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the row, for instance "3DGS, same time".
    pub name: String,
    /// Path of the scene file.
    pub path: PathBuf,
    /// PSNR, mean over the test views, dB.
    pub psnr: f64,
    /// SSIM, mean over the test views.
    pub ssim: f64,
    /// LPIPS, mean over the test views; `None` without the network's weights.
    #[serde(default)]
    pub lpips: Option<f64>,
    /// PSNR of the pixels in masks, mean over the test views that show objects, dB.
    pub psnr_in_masks: Option<f64>,
    /// Figures of each test view.
    pub views: Vec<RowView>,
    /// Wall time of all trainings behind the scene, without loading and evaluation, seconds.
    pub seconds: f64,
    /// Steps of all trainings behind the scene, including those of the plain cloud.
    pub steps: u64,
    /// Length of the scene file, bytes.
    pub file_bytes: u64,
    /// Size of the tensors uploaded to the device, as f32, bytes.
    pub host_bytes: u64,
    /// Number of Gaussians after expanding instances.
    pub gaussians: u64,
}

/// One test view of a [`Row`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RowView {
    /// Name of the view's camera.
    pub name: String,
    /// PSNR of the view, dB.
    pub psnr: f64,
    /// PSNR of the pixels in masks, dB; `None` if there are none.
    pub psnr_in_masks: Option<f64>,
}

/// Device, views and options with which rows are measured.
pub struct Measure<'a> {
    /// Device that renders.
    pub gpu: &'a Arc<Gpu>,
    /// Views to compare with.
    pub views: &'a [View],
    /// Photos are downscaled to this width, pixels; `None` = full size.
    pub width: Option<u32>,
    /// How scenes are rendered.
    pub options: RenderOptions,
    /// Masks of the objects, if there are any.
    pub masks: Option<&'a MaskFolder>,
    /// Network of LPIPS, if its weights are there.
    pub lpips: Option<&'a Lpips>,
}

/// Errors of [`Measure::row`].
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A scene, photo or mask cannot be read.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A view cannot be rendered or compared.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// The scene does not fit on the device.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl Measure<'_> {
    /// Renders the views of a scene file and compares them with the photos; `on_picture` receives each view.
    ///
    /// # Errors
    /// A file that cannot be read, or a scene that cannot be rendered.
    pub fn row(
        &self,
        name: &str,
        path: &Path,
        on_picture: &mut dyn FnMut(&Evaluated<'_>),
    ) -> Result<Row, MeasureError> {
        let loaded = load_scene(path)?;
        let mut renderer = Renderer::new(self.gpu)?;
        let scene = renderer.upload(&loaded.scene)?;
        let mut views = Vec::new();
        let report = evaluate::<MeasureError>(
            &mut renderer,
            &scene,
            self.views,
            self.width,
            &self.options,
            Extras { lpips: self.lpips, exposures: false },
            |view| {
                on_picture(&view);
                let psnr_in_masks = self.psnr_in_mask(view.name, view.pair)?;
                views.push(RowView { name: view.name.into(), psnr: view.metrics.psnr, psnr_in_masks });
                Ok(())
            },
        )?;
        let within: Vec<f64> = views.iter().filter_map(|v| v.psnr_in_masks).collect();
        Ok(Row {
            name: name.into(),
            path: path.into(),
            psnr: report.mean.psnr,
            ssim: report.mean.ssim,
            lpips: report.mean.lpips,
            psnr_in_masks: (!within.is_empty()).then(|| within.iter().sum::<f64>() / within.len() as f64),
            views,
            seconds: 0.0,
            steps: 0,
            file_bytes: loaded.file_bytes,
            host_bytes: loaded.scene.tensor_bytes(),
            gaussians: loaded.scene.expanded_len(),
        })
    }

    /// PSNR of the pixels of objects that count; `None` without a mask, or without such pixels.
    fn psnr_in_mask(&self, name: &str, pair: &PicturePair) -> Result<Option<f64>, MeasureError> {
        let view = self.views.iter().find(|view| view.camera.name == name);
        let (Some(masks), Some(view)) = (self.masks, view) else { return Ok(None) };
        let Some(mask) = masks.of_view(view)? else { return Ok(None) };
        let within: Vec<bool> = mask.resized(pair.width(), pair.height()).ids.iter().map(|&id| id != 0).collect();
        match pair.within(&within) {
            Ok(masked) => Ok(Some(psnr(&masked))),
            Err(PairError::NothingToCompare) => Ok(None),
            Err(error) => Err(EvalError::Pair { view: name.into(), error }.into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_each_may_draw_is_said_where_instances_may_draw_more() {
        let limits = |max_expanded: f64| {
            let mut config = TrainConfig { max_gaussians: 40_000, ..TrainConfig::default() };
            config.joint.max_expanded = max_expanded;
            DrawLimits::of(&config)
        };
        assert_eq!(limits(1.2), DrawLimits { plain: 40_000, instanced: 48_000 });
        let text = limits(1.2).text().unwrap_or_default();
        assert!(text.contains("48,000") && text.contains("40,000") && text.contains("max_expanded"), "{text}");
        assert_eq!([limits(1.0).text(), limits(0.6).text()], [None, None]);
    }
}
