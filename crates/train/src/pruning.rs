//! Removes what pictures lose least by: the squared error that each expanded Gaussian's absence adds, from its sensitivity.
//!
//! A pixel's colour is affine in each alpha, so taking one Gaussian away changes it by exactly `alpha dC/dalpha`. The opacity's
//! logit l has `dalpha/dl = alpha (1 - o)` with the opacity o, so the change is `(dC/dl) / (1 - o)` in every pixel, and the mean
//! of its square is the sensitivity to the logit over `(1 - o)^2`. Alphas above 0.99 have no derivative and are missed, and
//! errors of several Gaussians are added as if they were independent: both make the prediction too good where much is removed.

use instgs_io::small::Sensitivity;
use instgs_vk::math::covariance::sigmoid;
use instgs_vk::scene::removable::{Part, Removable, Removables};
use instgs_vk::scene::{Camera, InstancedScene, Parameter};

/// How much is to be removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PruneGoal {
    /// So that at most this part of the expanded Gaussians is left, above 0 and at most 1.
    Keep(f64),
    /// As long as the predicted PSNR of pictures against those of the whole scene stays above this, dB.
    PicturePsnr(f64),
}

/// A scene of fewer Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct Pruned {
    /// What is left.
    pub scene: InstancedScene,
    /// Number of expanded Gaussians that are no longer drawn.
    pub fewer: u64,
    /// How many of them are still stored, since other instances show the same Gaussian of their template.
    pub hidden: u64,
    /// The predicted PSNR of pictures against those of the whole scene, dB; `None` if nothing that shows was removed.
    pub picture_psnr_db: Option<f64>,
}

/// Removes expanded Gaussians in the order of what each costs. What no camera has in its frame stays, as other views may show
/// it. `sensitivity` is that of the scene from these cameras.
pub fn prune(scene: &InstancedScene, sensitivity: &Sensitivity, cameras: &[Camera], goal: PruneGoal) -> Pruned {
    let removables = Removables::of(scene);
    let costs = removal_costs(scene, &removables, sensitivity);
    let is_framed = |removable: &Removable| {
        removables
            .centres_world(scene, removable)
            .iter()
            .any(|&centre| cameras.iter().any(|camera| camera.pixel_of(centre).is_some_and(|at| camera.has_pixel(at))))
    };
    let mut order: Vec<usize> = (0..costs.len()).filter(|&i| is_framed(&removables.all[i])).collect();
    let per_draw = |i: usize| costs[i] / removables.all[i].draws() as f64;
    // Stable: those of the same cost go in the order of the scene.
    order.sort_by(|&a, &b| per_draw(a).total_cmp(&per_draw(b)));
    let before: usize = removables.all.iter().map(Removable::draws).sum();
    let (mut drawn, mut error) = (before as f64, 0.0);
    let mut is_removed = vec![false; costs.len()];
    for i in order {
        let goes = match goal {
            PruneGoal::Keep(part) => drawn > part * before as f64,
            PruneGoal::PicturePsnr(psnr_db) => error + costs[i] <= 10f64.powf(-psnr_db / 10.0),
        };
        if !goes {
            break;
        }
        is_removed[i] = true;
        drawn -= removables.all[i].draws() as f64;
        error += costs[i];
    }
    let (pruned, fewer) = removables.removed(scene, &is_removed);
    Pruned {
        fewer: fewer as u64,
        hidden: fewer as u64 - (scene.expanded_len() - pruned.expanded_len()),
        picture_psnr_db: (error > 0.0).then(|| -10.0 * error.log10()),
        scene: pruned,
    }
}

/// The mean squared error of pictures that each removal adds, in the order of [`Removables::all`]; colours from 0 to 1.
pub fn removal_costs(scene: &InstancedScene, removables: &Removables, sensitivity: &Sensitivity) -> Vec<f64> {
    let (templates, own) = (scene.templates.len(), scene.own.len());
    let sources = &sensitivity.rows[Parameter::OpacityLogits];
    let records = &sensitivity.rows[Parameter::OffsetOpacityLogits];
    // What a template's Gaussian shows by offsets is part of its own sensitivity.
    let mut by_offsets = vec![0.0; templates];
    for removable in &removables.all {
        if let Part::Record { record, gaussian } = removable.part {
            by_offsets[gaussian as usize] += f64::from(records[record as usize]);
        }
    }
    let shown = |part: Part| match part {
        Part::Record { record, .. } => f64::from(records[record as usize]),
        Part::Template(i) => (f64::from(sources[i as usize]) - by_offsets[i as usize]).max(0.0),
        Part::Own(i) => f64::from(sources[templates + i as usize]),
        Part::Background(i) => f64::from(sources[templates + own + i as usize]),
    };
    let cost = |removable: &Removable| {
        let logit = f64::from(Removables::opacity_logit(scene, removable.part));
        // 1 - o without cancellation.
        shown(removable.part) / sigmoid(-logit).powi(2)
    };
    removables.all.iter().map(cost).collect()
}
