//! Removes what pictures show least of: each expanded Gaussian is judged by the sum of its blending weights, alpha times the
//! transmittance in front of it, over all pixels of some views.
//!
//! What a picture would lose without a Gaussian is no measure: of two layers of one surface each can stand in for the other, both
//! would be missed little, and without both there is a hole. Weights of the layers behind are small, so the front one stays.

use std::sync::Arc;

use instgs_eval::{EvalError, PicturePair, psnr};
use instgs_vk::gpu::Gpu;
use instgs_vk::render::{CONTRIBUTION_ONE, ContributionRenderer, RenderOptions, Renderer};
use instgs_vk::scene::removable::{Removable, Removables};
use instgs_vk::scene::{Camera, InstancedScene};

use super::error::TrainError;

/// A scene of fewer Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct Pruned {
    /// What is left.
    pub scene: InstancedScene,
    /// Number of expanded Gaussians that are drawn; those that an earlier pruning has hidden are not.
    pub drawn: u64,
    /// Number of expanded Gaussians that are no longer drawn.
    pub fewer: u64,
    /// How many of them are still stored, since other instances show the same Gaussian of their template.
    pub hidden: u64,
}

/// Removes expanded Gaussians of least weight until at most a part of them, above 0 and at most 1, is drawn. What no camera has
/// in its frame stays, as other views may show it. Expands the scene: as a plain cloud it must fit into memory. `on_view` is
/// called after each camera.
///
/// # Errors
/// There are no cameras, a scene beyond the device's limits, or a failing device.
pub fn prune(
    gpu: &Arc<Gpu>,
    scene: &InstancedScene,
    cameras: &[Camera],
    keep: f64,
    on_view: impl FnMut(),
) -> Result<Pruned, TrainError> {
    if cameras.is_empty() {
        return Err(TrainError::NoViews);
    }
    let removables = Removables::of(scene);
    let weights = blending_weights(gpu, scene, cameras, on_view)?;
    let is_framed = |removable: &Removable| {
        let is_in = |centre| cameras.iter().any(|c| c.pixel_of(centre).is_some_and(|at| c.has_pixel(at)));
        removables.centres_world(scene, removable).into_iter().any(is_in)
    };
    let weight_per_draw = |removable: &Removable| {
        let sum: f64 = removables.flat_indices(removable).map(|flat| weights[flat]).sum();
        sum / removable.draws() as f64
    };
    let all = removables.all.iter().enumerate().filter(|(_, removable)| !Removables::is_hidden(scene, removable));
    let before: usize = all.clone().map(|(_, removable)| removable.draws()).sum();
    let mut order: Vec<(f64, usize)> = all
        .filter(|(_, removable)| is_framed(removable))
        .map(|(i, removable)| (weight_per_draw(removable), i))
        .collect();
    // Stable: those of the same weight go in the order of the scene.
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut drawn = before as f64;
    let goal = keep * drawn;
    let mut is_removed = vec![false; removables.all.len()];
    for (_, i) in order {
        if drawn <= goal {
            break;
        }
        is_removed[i] = true;
        drawn -= removables.all[i].draws() as f64;
    }
    let removed = removables.removed(scene, &is_removed);
    let (fewer, hidden) = (removed.fewer as u64, removed.hidden as u64);
    Ok(Pruned { drawn: before as u64 - fewer, fewer, hidden, scene: removed.scene })
}

/// By expanded Gaussian in flat order, the sum of its blending weights over all pixels of all cameras, pixels.
fn blending_weights(
    gpu: &Arc<Gpu>,
    scene: &InstancedScene,
    cameras: &[Camera],
    mut on_view: impl FnMut(),
) -> Result<Vec<f64>, TrainError> {
    let cloud = InstancedScene::from_cloud(scene.flatten());
    let options = RenderOptions::of(scene);
    let mut renderer = ContributionRenderer::new(gpu, &cloud)?;
    // Integers: the order of the cameras changes nothing.
    let mut sums = vec![0u64; cloud.background.len()];
    for camera in cameras {
        let everywhere = vec![0; camera.width as usize * camera.height as usize];
        let (contributions, _) = renderer.contributions(camera, &options, &everywhere)?;
        contributions.iter().for_each(|c| sums[c.gaussian as usize] += c.weight);
        on_view();
    }
    Ok(sums.into_iter().map(|sum| sum as f64 / f64::from(CONTRIBUTION_ONE)).collect())
}

/// PSNR between pictures of two scenes from these cameras, each with its own near plane and pixel filter: the mean over the cameras, dB.
///
/// # Errors
/// There are no cameras, a scene beyond the device's limits, or a failing device.
pub fn picture_psnr(gpu: &Arc<Gpu>, scenes: [&InstancedScene; 2], cameras: &[Camera]) -> Result<f64, TrainError> {
    if cameras.is_empty() {
        return Err(TrainError::NoViews);
    }
    let mut renderer = Renderer::new(gpu)?;
    let uploaded = [renderer.upload(scenes[0])?, renderer.upload(scenes[1])?];
    let mut sum = 0.0;
    for camera in cameras {
        let mut pictures = Vec::new();
        for (scene, uploaded) in scenes.iter().zip(&uploaded) {
            renderer.render(uploaded, camera, &RenderOptions::of(scene))?;
            let picture = renderer.download()?;
            pictures.push(picture.colors.iter().map(|&[r, g, b, _]| [r, g, b]).collect::<Vec<_>>());
        }
        let pair = PicturePair::new((camera.width, camera.height), &pictures[0], &pictures[1], None);
        sum += psnr(&pair.map_err(|error| EvalError::Pair { view: camera.name.clone(), error })?);
    }
    Ok(sum / cameras.len() as f64)
}
