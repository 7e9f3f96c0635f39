//! Labels of Gaussians from masks: Eq. 2-5 of the paper, for all instances at once.
//!
//! A Gaussian gets the instance k with the largest `In - alpha Out` above 0, where `In` is its weight inside k's masks
//! and `Out` its weight elsewhere in the views in which k has a mask. All views are swept twice: for `In`, then for
//! `Out` of the pairs found by the first sweep. The second sweep renders nothing while the views fit into memory
//! ([`super::sweep`]).
//!
//! Large faint Gaussians (haze) need no special rule: most of their weight lies outside of any one object.

use std::collections::BTreeMap;
use std::num::NonZero;
use std::sync::Arc;

use instgs_io::masks::Mask;
use instgs_vk::gpu::Gpu;
use instgs_vk::render::{CONTRIBUTION_ONE, RenderOptions};
use instgs_vk::scene::{Camera, InstancedScene};

use super::error::SegmentError;
use super::id_table::IdTable;
use super::strays::drop_strays;
use super::sweep::{KEPT_BYTES, ViewContributions};
use super::unseen::label_unseen;
use super::votes::Votes;

/// Options of [`label()`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LabelOptions {
    /// Weight of what lies outside of an instance's masks, >= 0. A Gaussian belongs to an instance if more than alpha /
    /// (1 + alpha) of it is inside. The paper uses 0.8.
    pub alpha: f64,
    /// Gaussians that no view shows take the majority label of this many neighbours; 0 leaves them in the background.
    pub unseen_neighbours: usize,
    /// Whether small groups of an object's Gaussians that are apart from it return to the background
    /// ([`super::strays`]).
    pub drop_strays: bool,
    /// How the views are rendered; should match training.
    pub render: RenderOptions,
}

impl Default for LabelOptions {
    /// The paper's alpha and eight neighbours; strays are kept.
    fn default() -> Self {
        Self { alpha: 0.8, unseen_neighbours: 8, drop_strays: false, render: RenderOptions::default() }
    }
}

/// Counts for one instance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InstanceStats {
    /// Gaussians with its label.
    pub gaussians: u32,
    /// Views in which it has a mask.
    pub views: u32,
}

/// Labels of all Gaussians, and statistics of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Labels {
    /// Object of each Gaussian; 0 is the background.
    pub instance_of_gaussian: Vec<u32>,
    /// Weight of each Gaussian: the sum of alpha T over all pixels of all views, in pixels; 0 = never seen.
    pub weights_px: Vec<f64>,
    /// Number of views in which each Gaussian contributes to a pixel.
    pub views_seen: Vec<u32>,
    /// Counts for every object that has a mask.
    pub instances: BTreeMap<u32, InstanceStats>,
    /// Number of unseen Gaussians that got the label of their neighbours.
    pub filled: usize,
    /// Number of strays that returned to the background.
    pub strays: usize,
}

/// Progress of [`label()`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LabelProgress {
    /// Views done, counted over both sweeps.
    pub done: usize,
    /// Twice the number of views.
    pub total: usize,
}

/// Labels the Gaussians of a plain cloud. `mask_of_view` gives the mask of a view by its index in `cameras`, or `None`
/// if it has none; a mask of another size than the camera is resized. `progress` is called after each view. Both can
/// stop the run with an error of the caller's type `E`.
///
/// # Errors
/// A cloud that has instances or does not fit on the device; a camera that cannot be rendered; a mask whose number of
/// ids is not its size; an alpha that is not a finite number >= 0; no mask with an object; errors of `mask_of_view` and
/// `progress`.
pub fn label<E: From<SegmentError>>(
    gpu: &Arc<Gpu>,
    cloud: &InstancedScene,
    cameras: &[Camera],
    mask_of_view: impl FnMut(usize) -> Result<Option<Mask>, E>,
    options: &LabelOptions,
    progress: impl FnMut(LabelProgress) -> Result<(), E>,
) -> Result<Labels, E> {
    check(options)?;
    let mut views = ViewContributions::new(gpu, cloud, cameras, mask_of_view, options.render, KEPT_BYTES)?;
    label_views(&mut views, &cloud.background.means, &IdTable::Same, options, progress)
}

/// Like [`label()`], from contributions that may already be in memory, with the objects of `table`. `means` are the
/// Gaussians' centres, world frame.
///
/// # Errors
/// Those of [`label()`].
pub fn label_views<E: From<SegmentError>>(
    views: &mut ViewContributions<'_, E>,
    means: &[[f32; 3]],
    table: &IdTable,
    options: &LabelOptions,
    mut progress: impl FnMut(LabelProgress) -> Result<(), E>,
) -> Result<Labels, E> {
    check(options)?;
    let view_count = views.view_count();
    let total = 2 * view_count;
    let mut votes = Votes::new(means.len());
    let mut objects_of_view: Vec<Vec<u16>> = Vec::with_capacity(view_count);
    views.for_each(|entries| {
        votes.add_weights(entries.contributions);
        votes.add_inside(&table.translated(entries.view, entries.contributions));
        objects_of_view.push(table.objects_of_view(entries.view, entries.ids));
        progress(LabelProgress { done: entries.view + 1, total })
    })?;
    // If consensus found no objects, there is nothing to label, but the scene is still built.
    if *table == IdTable::Same && objects_of_view.iter().all(Vec::is_empty) {
        return Err(SegmentError::NoMasks.into());
    }
    views.for_each(|entries| {
        let has_mask = by_id(&objects_of_view[entries.view]);
        votes.add_shown(&table.translated(entries.view, entries.contributions), &has_mask);
        progress(LabelProgress { done: view_count + entries.view + 1, total })
    })?;
    Ok(decide(means, &votes, &objects_of_view, options))
}

fn check(options: &LabelOptions) -> Result<(), SegmentError> {
    if options.alpha.is_finite() && options.alpha >= 0.0 {
        return Ok(());
    }
    let reason = format!("{} is not a finite number >= 0", options.alpha);
    Err(SegmentError::Option { option: "alpha", reason })
}

/// True at every id in `ids`; 65536 entries.
fn by_id(ids: &[u16]) -> Vec<bool> {
    let mut out = vec![false; usize::from(u16::MAX) + 1];
    ids.iter().for_each(|&id| out[usize::from(id)] = true);
    out
}

/// Turns votes into labels and counts them.
fn decide(means: &[[f32; 3]], votes: &Votes, objects_of_view: &[Vec<u16>], options: &LabelOptions) -> Labels {
    let mut labels = votes.winners(options.alpha);
    let seen: Vec<bool> = votes.weights().iter().map(|&weight| weight > 0).collect();
    let fill = |neighbours| label_unseen(means, &seen, &mut labels, neighbours);
    let filled = NonZero::new(options.unseen_neighbours).map_or(0, fill);
    let strays = if options.drop_strays { drop_strays(means, &mut labels) } else { 0 };
    let mut instances: BTreeMap<u32, InstanceStats> = BTreeMap::new();
    for &id in objects_of_view.iter().flatten() {
        instances.entry(u32::from(id)).or_default().views += 1;
    }
    for &id in labels.iter().filter(|&&id| id != 0) {
        instances.entry(u32::from(id)).or_default().gaussians += 1;
    }
    let one = f64::from(CONTRIBUTION_ONE);
    Labels {
        instance_of_gaussian: labels.into_iter().map(u32::from).collect(),
        weights_px: votes.weights().iter().map(|&weight| weight as f64 / one).collect(),
        views_seen: votes.views().to_vec(),
        instances,
        filled,
        strays,
    }
}
