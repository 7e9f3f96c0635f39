//! Masks without a segmenter: from a trained plain cloud and boxes around its objects, in the world or in photos.
//!
//! Boxes without an id are grouped into objects first (`join`). Each Gaussian goes to the object in whose boxes it lies
//! deepest (`claims`, `carve`), outliers and the ground below objects are removed (`support`), and masks are drawn from
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

use instgs_io::View;
use instgs_io::masks::Mask;
use instgs_vk::gpu::Gpu;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::{Boxes, Camera, InstancedScene, UpAxes};

use super::error::SegmentError;
use super::label::{LabelOptions, LabelProgress};
use super::sweep::{KEPT_BYTES, ViewContributions};
use super::unseen::label_unseen;

use carve::carve;
use claims::{claims_of_boxes, leave_out_far, settled};
use join::{Joined, join};
use placed::PlacedBoxes;
use sets::BoxSets;
use support::Supports;

pub use draw::draw_masks;
pub use report::{BoxObject, BoxReport, BoxSource};

/// Options of [`masks_from_boxes`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxOptions {
    /// Part of a Gaussian's contribution to the views with a box of an object that must lie in these boxes, 0..=1. 0.9
    /// allows for boxes that are exact to a few pixels, the width of small Gaussians at an object's rim.
    pub inside_part: f64,
    /// Whether the ground or table below an object is removed from it.
    pub leave_out_support: bool,
    /// Width of the pictures in which boxes are carved and masks drawn, pixels; `None` = that of the photos. Masks
    /// always have the size of the photos.
    pub width: Option<u32>,
    /// Gaussians that no view shows take the majority label of this many neighbours; 0 leaves them out.
    pub unseen_neighbours: usize,
    /// Seed of the random planes that are tried as supports.
    pub seed: u64,
    /// How the views are rendered; should match training.
    pub render: RenderOptions,
}

impl Default for BoxOptions {
    /// The values that the fields' comments explain.
    fn default() -> Self {
        let LabelOptions { unseen_neighbours, render, .. } = LabelOptions::default();
        Self { inside_part: 0.9, leave_out_support: true, width: None, unseen_neighbours, seed: 0, render }
    }
}

/// Result of [`masks_from_boxes`].
#[derive(Clone, Debug, PartialEq)]
pub struct BoxMasks {
    /// Object id of each Gaussian, 0 = none.
    pub labels: Vec<u16>,
    /// Names of object ids, for `categories.json`.
    pub categories: BTreeMap<u32, String>,
    /// Statistics, and notes about boxes that were left out.
    pub report: BoxReport,
}

/// Checks boxes before there is a cloud: places them in the views and groups those without ids into objects. Returns notes
/// about boxes that are left out.
///
/// # Errors
/// Options out of range; no usable box; more objects than ids.
pub fn usable_boxes(views: &[View], boxes: &Boxes, options: &BoxOptions) -> Result<Vec<String>, SegmentError> {
    Ok(Found::new(views, boxes, options)?.report.notes)
}

/// Labels a plain cloud by boxes and draws the mask of every view. `sink` receives the masks in order, with the index
/// of the view; they have the size and lens distortion of the view's photo, as [`instgs_io::MaskFolder`] reads them.
/// For an object with a box in the world, its boxes in photos are ignored. `progress` is called after each view. Both
/// can stop the run with an error of the caller's type `E`.
///
/// # Errors
/// A cloud that has instances or does not fit on the device; a camera that cannot be rendered; options out of range; no
/// usable box, or none with a Gaussian; more objects than ids; errors of `sink` and `progress`.
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
    if labels.iter().all(|&label| label == 0) {
        let notes = found.report.objects.iter().filter_map(nothing_note).chain(found.report.notes).collect();
        return Err(SegmentError::NothingInBoxes { notes }.into());
    }
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

/// The objects of all boxes, before Gaussians are labelled.
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
        let free = (usize::from(u16::MAX) + 1).saturating_sub(first_id as usize);
        if joined.objects > free {
            return Err(SegmentError::NoFreeIds { wanted: joined.objects, free });
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
        if report.objects.is_empty() {
            return Err(SegmentError::NoBoxes { notes: report.notes });
        }
        report.objects.sort_by_key(|object| object.id);
        Ok(Self { placed, report })
    }

    /// Object id of each Gaussian, 0 = none.
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

    /// Sets the labels of Gaussians on or below what their objects stand on to 0.
    fn leave_out_support(&mut self, cloud: &InstancedScene, labels: &mut [u16], seed: u64) {
        let background = &cloud.background;
        let axes = UpAxes::of(&self.placed.cameras, background.means.iter().copied());
        let level = axes.level.map(|up| Supports::below(background, labels, up, seed));
        let straight = axes.straight.map(|normal| Supports::behind(background, labels, normal, seed));
        // On a flight, whose level axis is the north, objects stand on the ground; on a shelf, on its boards.
        let Some(found) = level.into_iter().chain(straight).reduce(|a, b| if b.count() > a.count() { b } else { a })
        else {
            let text = "the cameras give no up axis, so the ground below objects was not removed";
            self.report.notes.push(text.into());
            return;
        };
        found.under.values().flatten().flatten().for_each(|&i| labels[i as usize] = 0);
        for object in &mut self.report.objects {
            let under = u16::try_from(object.id).ok().and_then(|id| found.under.get(&id)?.as_ref());
            object.support = under.map(Vec::len);
        }
    }
}

fn reported(id: u32, category: Option<String>, source: BoxSource, boxes: usize) -> BoxObject {
    BoxObject { id, category, source, boxes, gaussians: 0, support: None, views: 0 }
}

/// Removes boxes in photos of objects that have a box in the world.
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
        "{} boxes without an id match no object in three views and were left out; {} objects were found; boxes of one object that have \
         the same id need no match",
        joined.left, joined.objects
    );
    (joined.left > 0).then_some(text)
}

fn nothing_note(object: &BoxObject) -> Option<String> {
    let name = object.category.as_ref().map_or(String::new(), |name| format!(" ({name})"));
    let what = match (object.gaussians, object.support, object.views) {
        (0, Some(1..), _) => "all Gaussians in its box belong to the ground below it; make the box larger",
        (0, ..) => "no Gaussian lies in its box; is it in the same place and frame as the scene?",
        (_, _, 0) => "it is visible in no view, so no mask has it",
        _ => return None,
    };
    Some(format!("object {}{name}: {what}", object.id))
}

/// The most frequent text; the first in the alphabet in a tie.
fn most_frequent<'a>(texts: impl Iterator<Item = &'a String>) -> Option<String> {
    let mut counts: BTreeMap<&String, usize> = BTreeMap::new();
    texts.for_each(|text| *counts.entry(text).or_default() += 1);
    let most = counts.values().max()?;
    counts.iter().find(|(_, count)| *count == most).map(|(text, _)| (*text).clone())
}
