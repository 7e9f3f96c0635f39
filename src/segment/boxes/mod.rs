//! Masks without a segmenter: from a trained plain cloud and boxes around its objects, in the world or in photos.
//!
//! Boxes without an object are joined first (`join`). Then each Gaussian goes to the object in whose boxes it lies
//! (`claims`, `carve`), but for what is far from it and what the objects stand on (`support`), and masks are drawn of
//! the labelled cloud ([`draw_masks`]).

mod carve;
mod claims;
mod draw;
mod join;
mod placed;
mod report;
mod sets;
mod support;

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZero;
use std::sync::Arc;
use std::time::Instant;

use crate::gpu::Gpu;
use crate::io::View;
use crate::io::masks::Mask;
use crate::render::RenderOptions;
use crate::scene::{Boxes, Camera, InstancedScene, up_direction};

use super::error::SegmentError;
use super::label::{LabelOptions, LabelProgress};
use super::sweep::{KEPT_BYTES, ViewContributions};
use super::unseen::label_unseen;

use carve::carve;
use claims::{claims_of_boxes, leave_out_far, settled};
use join::{Joined, join};
use placed::PlacedBoxes;
use sets::BoxSets;
use support::leave_out_support;

pub use draw::draw_masks;
pub use report::{BoxObject, BoxReport, BoxSource};

/// How Gaussians are given to boxes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxOptions {
    /// A Gaussian may be of an object if this part of what it adds to views with a box of the object lies in these boxes,
    /// 0..=1. Of 0.8, 0.9 and 0.95, 0.9 gave the best masks of the cars, the hall and the orchard: boxes are exact to a
    /// few pixels, and small Gaussians at an object's rim are as wide as that.
    pub inside_part: f64,
    /// What objects stand on is left out.
    pub leave_out_support: bool,
    /// Boxes in photos are carved, and masks drawn, at this width of the photos, `None` = their own. Masks have the photos'
    /// size always.
    pub width: Option<u32>,
    /// Gaussians that no view shows follow the majority of this many neighbours; 0 leaves them out.
    pub unseen_neighbours: usize,
    /// Seed of the planes that are tried as supports.
    pub seed: u64,
    /// How the views are rendered: as the cloud was trained.
    pub render: RenderOptions,
}

impl Default for BoxOptions {
    /// As the fields say.
    fn default() -> Self {
        let LabelOptions { unseen_neighbours, render, .. } = LabelOptions::default();
        Self { inside_part: 0.9, leave_out_support: true, width: None, unseen_neighbours, seed: 0, render }
    }
}

/// What boxes gave.
#[derive(Clone, Debug, PartialEq)]
pub struct BoxMasks {
    /// By Gaussian: id of its object, 0 = none.
    pub labels: Vec<u16>,
    /// Names of ids, for `categories.json`.
    pub categories: BTreeMap<u32, String>,
    /// What became of the boxes.
    pub report: BoxReport,
}

/// Labels a plain cloud by boxes and draws the mask of every view from it. `sink` takes the masks, one at a time, with the
/// index of the view; they have the size and lens distortion of the view's photo, as [`crate::io::MaskFolder`] reads them.
/// An object with a box in the world is found by that alone. `progress` is told after each view; `E` is an error of the
/// caller's, with which either can stop.
///
/// # Errors
/// A cloud with instances or beyond the device; a camera that cannot be rendered; options out of range; no box that is
/// in the world or in one of the views; more objects than ids; what `sink` or `progress` return.
pub fn masks_from_boxes<E: From<SegmentError>>(
    gpu: &Arc<Gpu>,
    cloud: &InstancedScene,
    views: &[View],
    boxes: &Boxes,
    options: &BoxOptions,
    mut sink: impl FnMut(usize, &Mask) -> Result<(), E>,
    mut progress: impl FnMut(LabelProgress) -> Result<(), E>,
) -> Result<BoxMasks, E> {
    let started = Instant::now();
    let mut found = Found::new(views, boxes, options)?;
    let sweeps = if found.placed.has_boxes() { 2 * views.len() } else { 0 };
    let total = sweeps + views.len();
    let labels = found.labels(gpu, cloud, boxes, options, |done| progress(LabelProgress { done, total }))?;
    let views_of_id = draw_masks(gpu, cloud, &labels, views, options.width, &options.render, |view, mask| {
        sink(view, mask)?;
        progress(LabelProgress { done: sweeps + view + 1, total })
    })?;
    for object in &mut found.report.objects {
        object.gaussians = labels.iter().filter(|&&label| u32::from(label) == object.id).count();
        object.views = u16::try_from(object.id).ok().and_then(|id| views_of_id.get(&id).copied()).unwrap_or(0);
        found.report.notes.extend(nothing_note(object));
    }
    found.report.seconds = started.elapsed().as_secs_f64();
    let named = |object: &BoxObject| Some((object.id, object.category.clone()?));
    let categories = found.report.objects.iter().filter_map(named).collect();
    Ok(BoxMasks { labels, categories, report: found.report })
}

/// The objects that boxes speak of.
struct Found {
    placed: PlacedBoxes,
    report: BoxReport,
}

impl Found {
    fn new(views: &[View], boxes: &Boxes, options: &BoxOptions) -> Result<Self, SegmentError> {
        if !(options.inside_part > 0.0 && options.inside_part <= 1.0) {
            let reason = format!("{} is not above 0 and at most 1", options.inside_part);
            return Err(SegmentError::Option { option: "inside_part", reason });
        }
        let mut report = BoxReport::default();
        let mut placed = PlacedBoxes::new(views, boxes, options.width, &mut report.notes);
        let in_world: BTreeSet<u32> = boxes.objects.iter().map(|object| object.id).collect();
        if !placed.has_boxes() && in_world.is_empty() {
            return Err(SegmentError::NoBoxes { notes: report.notes });
        }
        drop_boxes_of(&in_world, &mut placed, &mut report.notes);
        let in_photos = boxes.views.values().flatten().filter_map(|b| b.id);
        let first_id = in_world.iter().copied().chain(in_photos).max().unwrap_or(0) + 1;
        let joined = join(&mut placed, first_id);
        if first_id as usize + joined.objects > usize::from(u16::MAX) + 1 {
            return Err(SegmentError::TooManyObjects { count: first_id as usize - 1 + joined.objects });
        }
        report.notes.extend(left_note(&joined));
        for object in &boxes.objects {
            report.objects.push(reported(object.id, object.category.clone(), BoxSource::World, 0));
        }
        for (id, of_object) in placed.by_object() {
            let id = u32::from(id);
            let source = if id >= first_id { BoxSource::Joined } else { BoxSource::Photos };
            let category = most_frequent(of_object.iter().filter_map(|(_, b)| b.category.as_ref()));
            report.objects.push(reported(id, category, source, of_object.len()));
        }
        report.objects.sort_by_key(|object| object.id);
        Ok(Self { placed, report })
    }

    /// By Gaussian: id of its object.
    fn labels<E: From<SegmentError>>(
        &mut self,
        gpu: &Arc<Gpu>,
        cloud: &InstancedScene,
        boxes: &Boxes,
        options: &BoxOptions,
        progress: impl FnMut(usize) -> Result<(), E>,
    ) -> Result<Vec<u16>, E> {
        let gaussians = &cloud.background;
        let mut claims = claims_of_boxes(gaussians, &boxes.objects);
        let mut is_seen = vec![true; gaussians.len()];
        if self.placed.has_boxes() {
            let cameras = &self.placed.cameras;
            let of_view =
                |(camera, list): (&Camera, &Vec<_>)| BoxSets::new(&camera.name, [camera.width, camera.height], list);
            let sets: Result<Vec<BoxSets>, SegmentError> =
                cameras.iter().zip(&self.placed.by_view).map(of_view).collect();
            let sets = sets?;
            let mask_of_view = |view: usize| Ok(Some(sets[view].mask()));
            let mut sweep = ViewContributions::<E>::new(gpu, cloud, cameras, mask_of_view, options.render, KEPT_BYTES)?;
            let carved = carve(&mut sweep, gaussians, &self.placed, &sets, options.inside_part, progress)?;
            claims.extend(carved.claims);
            is_seen = carved.is_seen;
        }
        let mut labels = settled(&claims, gaussians.len());
        is_seen.iter_mut().zip(&labels).for_each(|(seen, label)| *seen |= *label != 0);
        if let Some(neighbours) = NonZero::new(options.unseen_neighbours) {
            label_unseen(&gaussians.means, &is_seen, &mut labels, neighbours);
        }
        self.report.far = leave_out_far(gaussians, &mut labels);
        if options.leave_out_support {
            self.leave_out_support(cloud, &mut labels, options.seed);
        }
        Ok(labels)
    }

    fn leave_out_support(&mut self, cloud: &InstancedScene, labels: &mut [u16], seed: u64) {
        let Some(up) = up_direction(&self.placed.cameras) else {
            let text = "the cameras do not agree on what is up, so what objects stand on was not left out";
            self.report.notes.push(text.into());
            return;
        };
        let support = leave_out_support(&cloud.background, labels, up, seed);
        for object in &mut self.report.objects {
            object.support = u16::try_from(object.id).ok().and_then(|id| *support.get(&id)?);
        }
    }
}

fn reported(id: u32, category: Option<String>, source: BoxSource, boxes: usize) -> BoxObject {
    BoxObject { id, category, source, boxes, gaussians: 0, support: None, views: 0 }
}

/// Objects with a box in the world need none in photos.
fn drop_boxes_of(ids: &BTreeSet<u32>, placed: &mut PlacedBoxes, notes: &mut Vec<String>) {
    let mut dropped = 0;
    for boxes in &mut placed.by_view {
        let before = boxes.len();
        boxes.retain(|b| !ids.contains(&u32::from(b.object)));
        dropped += before - boxes.len();
    }
    if dropped > 0 {
        notes.push(format!("{dropped} boxes in photos are of objects that have a box in the world, and were left out"));
    }
}

fn left_note(joined: &Joined) -> Option<String> {
    let text = format!(
        "{} boxes without an id are of no object that three views agree on, and were left out; {} objects were found",
        joined.left, joined.objects
    );
    (joined.left > 0).then_some(text)
}

fn nothing_note(object: &BoxObject) -> Option<String> {
    let name = object.category.as_ref().map_or(String::new(), |name| format!(" ({name})"));
    let what = match (object.gaussians, object.support, object.views) {
        (0, Some(1..), _) => "all Gaussians in its box are of what lies below it; make the box larger",
        (0, ..) => "no Gaussian lies in its box; is it in the same place and frame as the scene?",
        (_, _, 0) => "no view shows it, so no mask has it",
        _ => return None,
    };
    Some(format!("object {}{name}: {what}", object.id))
}

/// The most frequent text, of equals the first in the alphabet.
fn most_frequent<'a>(texts: impl Iterator<Item = &'a String>) -> Option<String> {
    let mut counts: BTreeMap<&String, usize> = BTreeMap::new();
    texts.for_each(|text| *counts.entry(text).or_default() += 1);
    let most = counts.values().max()?;
    counts.iter().find(|(_, count)| *count == most).map(|(text, _)| (*text).clone())
}
