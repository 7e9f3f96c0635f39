//! Trains all levels of a template, the finest first.

use std::sync::Arc;

use instgs_eval::{EvalError, PicturePair, psnr};
use instgs_train::TrainError;
use instgs_train::step_runner::StepRunner;
use instgs_vk::gpu::Gpu;
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::render::{Picture, Renderer};
use instgs_vk::scene::lod::FittedLevel;
use instgs_vk::scene::{Gaussians, InstancedScene, PixelFilter};

use crate::fit::{Target, Training, fit};
use crate::views::{Ball, LevelSize, MOST_PX, views_around};

/// Views that judge a level, which it is not trained on.
const JUDGES: usize = 16;

/// What the levels of a template are trained with.
#[derive(Clone, Copy, Debug)]
pub struct FitOptions {
    /// Training steps of each level.
    pub steps: u64,
    /// Views of each level.
    pub views: usize,
    /// Fixes directions and backgrounds of the views.
    pub seed: u64,
}

/// How close a level is to its template, in views that it was not trained on.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct LevelReport {
    /// Side of the cells, template units.
    pub cell: f32,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// PSNR of the level by merging against the template at full detail, dB.
    pub merged_psnr_db: f64,
    /// PSNR of the trained level, dB.
    pub fitted_psnr_db: f64,
    /// Whether the trained level is closer, and thus part of the scene; if not, the one by merging is shown.
    pub is_kept: bool,
}

/// Trains the levels of a template, from those by merging ([`merged_levels`](instgs_vk::scene::lod::merged_levels)). A level that training does not bring closer to the template is left out, so that the
/// one by merging is shown. `on_level` is called after each.
///
/// # Errors
/// The device fails, or is too small for the template.
pub fn fit_template(
    gpu: &Arc<Gpu>,
    template: &Gaussians,
    merged: Vec<FittedLevel>,
    filter: PixelFilter,
    options: &FitOptions,
    mut on_level: impl FnMut(LevelReport),
) -> Result<Vec<FittedLevel>, TrainError> {
    let Some(ball) = Ball::around(template) else { return Ok(Vec::new()) };
    let mut renderer = Renderer::new(gpu)?;
    let scene = renderer.upload(&InstancedScene::from_cloud(template.clone()))?;
    let mut target = Target { gpu, renderer: &mut renderer, scene, filter };
    let mut runner = StepRunner::new(gpu, Variant::for_training(gpu.caps()), [MOST_PX; 2], false)?;
    let mut out = Vec::new();
    for (index, merged) in merged.into_iter().enumerate() {
        let cell = f64::from(merged.cell);
        let mut rng = Rng::new(options.seed).fork(index as u64);
        let size = LevelSize { ball, cell };
        let judges = views_around(size, &merged.gaussians, JUDGES, &mut rng);
        let views = views_around(size, &merged.gaussians, options.views, &mut rng);
        let training = Training { level: &merged.gaussians, cell, views: &views, steps: options.steps };
        let gaussians = fit(&mut target, &mut runner, &training)?;
        let truth = target.pictures(&judges)?;
        let of_merged = target.pictures_of(&merged.gaussians, &judges)?;
        let of_fitted = target.pictures_of(&gaussians, &judges)?;
        let [merged_psnr_db, fitted_psnr_db] = [psnr_db(&truth, &of_merged)?, psnr_db(&truth, &of_fitted)?];
        let is_kept = fitted_psnr_db > merged_psnr_db;
        let (cell, count) = (merged.cell, gaussians.len());
        on_level(LevelReport { cell, gaussians: count, merged_psnr_db, fitted_psnr_db, is_kept });
        if is_kept {
            out.push(FittedLevel { gaussians, ..merged });
        }
    }
    Ok(out)
}

/// PSNR over all pixels of all pictures, dB.
fn psnr_db(truth: &[Picture], other: &[Picture]) -> Result<f64, TrainError> {
    let pixels = |pictures: &[Picture]| -> Vec<[f32; 3]> {
        pictures.iter().flat_map(|picture| picture.colors.iter().map(|&[r, g, b, _]| [r, g, b])).collect()
    };
    let (truth, other) = (pixels(truth), pixels(other));
    // In one row, since PSNR does not care which pixels are neighbours.
    let pair = PicturePair::new((truth.len() as u32, 1), &other, &truth, None)
        .map_err(|error| EvalError::Pair { view: "of a level".into(), error })?;
    Ok(psnr(&pair))
}
