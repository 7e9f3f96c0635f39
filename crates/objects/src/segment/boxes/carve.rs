//! From boxes in photos to Gaussians: an object is where its boxes of all views meet.
//!
//! A Gaussian may be of an object if nearly all that it adds to the views with a box of the object lies in these boxes.
//! What it adds is what is seen of it, so a box around the visible part of an object that others hide in part takes
//! nothing away. Views without a box of the object say nothing of it: a detector misses objects, and a person draws few.

use rayon::prelude::*;

use crate::math::sh::widened;
use crate::scene::{Camera, Gaussians};
use crate::segment::error::SegmentError;
use crate::segment::sweep::ViewContributions;
use crate::segment::votes::{Vote, Votes};

use super::claims::Claim;
use super::placed::{PlacedBox, PlacedBoxes};
use super::sets::BoxSets;

/// What boxes in photos say.
pub(super) struct Carved {
    /// By Gaussian, then by object.
    pub(super) claims: Vec<Claim>,
    /// By Gaussian: true if any view shows it.
    pub(super) is_seen: Vec<bool>,
}

/// Carves all objects at once, in two sweeps over `views`, whose masks are those of `sets`. `inside_part` is how much of
/// what a Gaussian adds must be inside; `progress` is told the number of views done.
///
/// # Errors
/// As [`ViewContributions::for_each`]; what `progress` returns.
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

/// How deep a place of the world lies in the boxes that have it in their picture, on average; 0 if none has.
fn mean_depth(mean: [f32; 3], boxes: &[(usize, &PlacedBox)], cameras: &[Camera]) -> f64 {
    let place = widened(mean);
    let depth = |&(view, placed): &(usize, &PlacedBox)| {
        let camera = &cameras[view];
        camera.pixel_of(place).filter(|&at| camera.has_pixel(at)).map(|at| placed.depth(at))
    };
    let (sum, count) = boxes.iter().filter_map(depth).fold((0.0, 0u32), |(sum, n), depth| (sum + depth, n + 1));
    sum / f64::from(count.max(1))
}
