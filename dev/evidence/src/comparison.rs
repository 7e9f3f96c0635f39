//! The comparison protocol (DESIGN section 7): how good, how large and how fast an instanced scene is beside plain clouds
//! that had as much time, or may have as many bytes. Training them is the command line's; this measures and counts.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::eval::{EvalError, Evaluated, Lpips, PairError, PicturePair, evaluate, psnr};
use crate::gpu::Gpu;
use crate::io::{IoError, MaskFolder, View, load_scene};
use crate::render::{RenderError, RenderOptions, Renderer};
use crate::scene::RepeatedBytes;

/// Names of rows, which are also those of tables.
pub mod names {
    /// The plain cloud that the instanced scene is made of.
    pub const START: &str = "3DGS, the start";
    /// It, trained on for as long as the instanced scene took.
    pub const SAME_TIME: &str = "3DGS, same time";
    /// A plain cloud trained for as many steps as that, but in one piece: its rates decay once.
    pub const AT_ONCE: &str = "3DGS, same time at once";
    /// A plain cloud whose .ply is not larger than the packed instanced scene.
    pub const SAME_BYTES: &str = "3DGS, same bytes";
    /// As many Gaussians, placed by 3DGS-MCMC.
    pub const MCMC: &str = "3DGS-MCMC, same time";
    /// The cloud that had the same time, quantised per Gaussian.
    pub const SPZ: &str = "3DGS, same time, .spz";
    /// The same cloud, packed as [`OURS_SMALL`] is.
    pub const SAME_TIME_SMALL: &str = "3DGS, same time, small";
    /// Templates and poses without offsets: every instance looks the same.
    pub const RIGID: &str = "rigid copies";
    /// The instanced scene, as trained.
    pub const OURS: &str = "InstGS";
    /// With half floats.
    pub const OURS_F16: &str = "InstGS, f16";
    /// With offsets of 8 bits.
    pub const OURS_Q8: &str = "InstGS, q8";
    /// With offsets of 8 bits, and the rest in compressed steps.
    pub const OURS_SMALL: &str = "InstGS, small";
}

/// All scenes of one data set and seed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeedResult {
    /// Of all training.
    pub seed: u64,
    /// See [`names`].
    pub rows: Vec<Row>,
    /// Frames per second of the instanced scene, and of the cloud that had the same time; measured in turn.
    pub fps: Option<[f64; 2]>,
    /// (splat, tile) pairs of the same two, mean over the views.
    pub intersections: Option<[u64; 2]>,
    /// Milliseconds a frame by pass of the same two.
    pub passes_ms: Vec<(String, f64, f64)>,
    /// The repeated part of the scene.
    pub repeated: RepeatedBytes,
    /// Bytes as .ply of the plain cloud's own Gaussians that became instances, those left out as hardly seen not
    /// counted. Less than that of `repeated` where templates have more Gaussians than an object had.
    #[serde(default)]
    pub replaced_ply: u64,
    /// Steps for which the plain cloud would have been trained on by the clock, at the pace of its last steps.
    #[serde(default)]
    pub more_steps_by_clock: u64,
    /// Warnings about groups and objects.
    pub warnings: Vec<String>,
}

impl SeedResult {
    /// The row of that name.
    pub fn row(&self, name: &str) -> Option<&Row> {
        self.rows.iter().find(|row| row.name == name)
    }
}

/// One scene of a comparison.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What it is, for instance "3DGS, same time".
    pub name: String,
    /// Its file.
    pub path: PathBuf,
    /// Mean over the test views, dB.
    pub psnr: f64,
    /// Mean over the test views.
    pub ssim: f64,
    /// Mean over the test views; `None` without weights to compute it with.
    #[serde(default)]
    pub lpips: Option<f64>,
    /// Mean over the test views that show objects, of the pixels in masks, dB.
    pub psnr_in_masks: Option<f64>,
    /// By view.
    pub views: Vec<RowView>,
    /// Wall time of all training behind it, without loading and evaluation.
    pub seconds: f64,
    /// Steps behind it, those of the plain cloud included.
    pub steps: u64,
    /// Length of its file.
    pub file_bytes: u64,
    /// Tensors handed to the device, as f32.
    pub host_bytes: u64,
    /// Gaussians after expanding.
    pub gaussians: u64,
}

/// One test view of a [`Row`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RowView {
    /// View name.
    pub name: String,
    /// dB.
    pub psnr: f64,
    /// Of the pixels in masks; `None` if there are none.
    pub psnr_in_masks: Option<f64>,
}

/// Where and how rows are measured.
pub struct Measure<'a> {
    /// The device.
    pub gpu: &'a Arc<Gpu>,
    /// The views.
    pub views: &'a [View],
    /// Photos are downscaled to this width.
    pub width: Option<u32>,
    /// How scenes are rendered.
    pub options: RenderOptions,
    /// Masks of the objects.
    pub masks: Option<&'a MaskFolder>,
    /// The network of LPIPS.
    pub lpips: Option<&'a Lpips>,
}

/// Why a row could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A scene, photo or mask.
    #[error(transparent)]
    Io(#[from] IoError),
    /// Rendering or comparing.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// The scene on the device.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl Measure<'_> {
    /// Renders the views of a scene file and compares them; `on_picture` gets each.
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
            self.lpips,
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

    /// Of the pixels that belong to an object and count; `None` without a mask, or if there are none.
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
