//! From boxes in photos to Gaussians: an object is where its boxes of all views intersect.
//!
//! A Gaussian may belong to an object if nearly all of its contribution to the views with a box of the object lies in
//! these boxes. Contributions count only what is visible, so a box around the visible part of a partly hidden object
//! removes nothing. Views without a box of the object are ignored: a detector misses objects, and a person draws few
//! boxes.

use rayon::prelude::*;

use crate::segment::error::SegmentError;
use crate::segment::sweep::ViewContributions;
use crate::segment::votes::{Vote, Votes};
use instgs_vk::math::sh::widened;
use instgs_vk::scene::{Camera, Gaussians};

use super::claims::Claim;
use super::placed::{PlacedBox, PlacedBoxes};
use super::sets::BoxSets;

/// Result of carving with boxes in photos.
pub(super) struct Carved {
    /// Claims sorted by Gaussian, then by object.
    pub(super) claims: Vec<Claim>,
    /// By Gaussian: whether any view shows it.
    pub(super) is_seen: Vec<bool>,
}

/// Carves all objects at once, in two sweeps over `views`, whose masks are those of `sets`. `inside_part` is the part
/// of a Gaussian's contribution that must lie inside; `progress` receives the number of views done.
///
/// # Errors
/// Those of [`ViewContributions::for_each`]; errors of `progress`.
pub(super) fn carve<E: From<SegmentError>>(
    views: &mut ViewContributions<'_, E>,
    cloud: &Gaussians,
    placed: &PlacedBoxes,
    sets: &[BoxSets],
    inside_part: f64,
    mut progress: impl FnMut(usize) -> Result<(), E>,
) -> Result<Carved, E> {
    let view_count = views.view_count();
    let mut votes = Votes::new(cloud.len());
    views.for_each(|entries| {
        votes.add_weights(entries.contributions);
        votes.add_inside(&sets[entries.view].by_object(entries.contributions));
        progress(entries.view + 1)
    })?;
    let boxes_of_object = placed.by_object();
    let mut has_box = vec![false; usize::from(u16::MAX) + 1];
    views.for_each(|entries| {
        let own = || placed.by_view[entries.view].iter().map(|b| usize::from(b.object));
        own().for_each(|object| has_box[object] = true);
        votes.add_shown(entries.contributions, &has_box);
        own().for_each(|object| has_box[object] = false);
        progress(view_count + entries.view + 1)
    })?;
    let is_inside = |vote: &&Vote| vote.inside as f64 >= inside_part * vote.shown as f64;
    let inside: Vec<&Vote> = votes.all().iter().filter(is_inside).collect();
    let claim = |vote: &&Vote| {
        let boxes = boxes_of_object.get(&vote.id).map(Vec::as_slice).unwrap_or_default();
        let depth = mean_depth(cloud.means[vote.gaussian as usize], boxes, &placed.cameras);
        Claim { gaussian: vote.gaussian, object: vote.id, depth }
    };
    let claims = inside.par_iter().map(claim).collect();
    Ok(Carved { claims, is_seen: votes.weights().iter().map(|&weight| weight > 0).collect() })
}

/// Mean of [`PlacedBox::depth`] of a world point over the boxes whose picture contains it; 0 if none does.
fn mean_depth(mean: [f32; 3], boxes: &[(usize, &PlacedBox)], cameras: &[Camera]) -> f64 {
    let place = widened(mean);
    let depth = |&(view, placed): &(usize, &PlacedBox)| {
        let camera = &cameras[view];
        camera.pixel_of(place).filter(|&at| camera.has_pixel(at)).map(|at| placed.depth(at))
    };
    let (sum, count) = boxes.iter().filter_map(depth).fold((0.0, 0u32), |(sum, n), depth| (sum + depth, n + 1));
    sum / f64::from(count.max(1))
}
