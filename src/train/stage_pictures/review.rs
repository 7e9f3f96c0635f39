//! Every view with its masks painted over it: what `train::report::review_page` shows.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rayon::prelude::*;

use super::colors::Colors;
use super::inputs::{consensus_notes, picture_camera};
use super::masks::{Paint, painted};
use super::{VIEW_WIDTH_PX, object_paint, photo};
use crate::io::{IoError, Mask, MaskFolder, View};
use crate::math::statistics::median;
use crate::segment::Consensus;
use crate::train::error::TrainError;
use crate::train::report::{KindOfMasks, ObjectColor, ReviewSheet, ReviewView, write_review};

/// The sheet's name in a folder of masks, of segments, or of a run.
pub const REVIEW: &str = "review.html";
/// Views that a line names; of more it gives the number.
const NAMED_VIEWS: usize = 5;
/// Views with fewer masks than this part of the median are named: there a detector has probably missed objects.
const FEW_MASKS: f64 = 0.5;

/// Writes the sheet of the masks of `views`; with `found`, what became of them, too: the views are then those that
/// consensus counted by.
///
/// # Errors
/// A mask or a photo that is missing or damaged, or a file that cannot be written.
pub fn review(out: &Path, views: &[View], masks: &MaskFolder, found: Option<&Consensus>) -> Result<(), TrainError> {
    Ok(write_review(out, &sheet(views, masks, found)?)?)
}

fn sheet(views: &[View], masks: &MaskFolder, found: Option<&Consensus>) -> Result<ReviewSheet, TrainError> {
    let facts = views.par_iter().map(|view| ViewFacts::of(view, masks)).collect::<Vec<_>>();
    let facts = facts.into_iter().collect::<Result<Vec<_>, IoError>>()?;
    let given = Colors::of_ids(facts.iter().flat_map(|f| f.part_of_id.keys().copied()));
    let objects = found.map(|found| Colors::of_ids(found.report.objects.iter().map(|object| object.id)));
    let draw = |(index, view): (usize, &View)| -> Result<ReviewView, TrainError> {
        let pictures = pictures(index, view, masks, &given, found.zip(objects.as_ref()))?;
        Ok(ReviewView { name: view.camera.name.clone(), masks: facts[index].masks(), pictures })
    };
    let drawn = views.par_iter().enumerate().map(draw).collect::<Vec<_>>();
    let names = |found: &Consensus, id: u32| found.report.objects.iter().find(|o| o.id == id)?.category.clone();
    let legend = |(found, colors): (&Consensus, &Colors)| -> Vec<ObjectColor> {
        colors.ids().filter_map(|id| Some(ObjectColor { id, name: names(found, id), color: colors.of(id)? })).collect()
    };
    Ok(ReviewSheet {
        title: format!("Masks of {} views", views.len()),
        notes: notes(&facts, &given, found),
        warnings: warnings(views, &facts),
        kinds: kinds(&facts, &masks.categories),
        objects: found.map(|found| found.report.objects.clone()).unwrap_or_default(),
        colors: found.zip(objects.as_ref()).map(legend).unwrap_or_default(),
        views: drawn.into_iter().collect::<Result<_, _>>()?,
    })
}

/// What a view's mask holds.
struct ViewFacts {
    has_file: bool,
    /// By id: the part of the picture, 0..=1.
    part_of_id: BTreeMap<u32, f64>,
}

impl ViewFacts {
    fn of(view: &View, masks: &MaskFolder) -> Result<Self, IoError> {
        let mask = masks.of_view(view)?;
        let part = |mask: &Mask| -> BTreeMap<u32, f64> {
            let pixels = mask.ids.len().max(1) as f64;
            mask.ids_present().into_iter().map(|(id, n)| (u32::from(id), n as f64 / pixels)).collect()
        };
        Ok(Self { has_file: mask.is_some(), part_of_id: mask.as_ref().map(part).unwrap_or_default() })
    }

    fn masks(&self) -> Option<usize> {
        self.has_file.then_some(self.part_of_id.len())
    }
}

fn pictures(
    index: usize,
    view: &View,
    masks: &MaskFolder,
    given: &Colors,
    found: Option<(&Consensus, &Colors)>,
) -> Result<Vec<(&'static str, String)>, TrainError> {
    let photo = photo(view, &picture_camera(&view.camera, VIEW_WIDTH_PX))?;
    let fail = |what: String| IoError::new(&view.image_path, what);
    let Some(mask) = masks.of_view(view)? else { return Ok(vec![("photograph", photo.jpeg_address().map_err(fail)?)]) };
    let as_given = painted(&photo, &mask, |id| given.of(u32::from(id)).map_or(Paint::Nothing, Paint::Color));
    let mut out = vec![("masks as given", as_given.jpeg_address().map_err(fail)?)];
    if let Some((found, colors)) = found {
        let objects = painted(&photo, &mask, |id| object_paint(&found.table, index, id, colors));
        out.push(("objects", objects.jpeg_address().map_err(fail)?));
    }
    Ok(out)
}

fn notes(facts: &[ViewFacts], given: &Colors, found: Option<&Consensus>) -> Vec<String> {
    let counts: Vec<f64> = facts.iter().filter_map(|f| Some(f.masks()? as f64)).collect();
    let (least, most) = counts.iter().fold((f64::INFINITY, 0.0), |(a, b), &n| (f64::min(a, n), f64::max(b, n)));
    let mut out = Vec::new();
    if !counts.is_empty() {
        let (middle, ids) = (median(&counts), given.ids().count());
        let (with, all) = (counts.len(), facts.len());
        out.push(format!(
            "{with} of {all} views have masks: {least} to {most} of them in a view, {middle} in the middle, {ids} ids in \
             all."
        ));
    }
    match found {
        Some(found) => {
            out.extend(consensus_notes(&found.report));
            out.push("Left the masks as they were given, right the objects that they show.".into());
        }
        None => out.push(
            "Colours are ids. They need not be the same from view to view: which masks show the same object is \
             found out when the scene is segmented, and the sheet of that shows both."
                .into(),
        ),
    }
    if given.ids().count() > Colors::DISTINCT {
        out.push(format!("There are more than {} ids: colours repeat.", Colors::DISTINCT));
    }
    out
}

fn warnings(views: &[View], facts: &[ViewFacts]) -> Vec<String> {
    let counts: Vec<f64> = facts.iter().filter_map(|f| Some(f.masks()? as f64)).collect();
    let few = FEW_MASKS * median(&counts);
    let named = |which: &dyn Fn(&ViewFacts) -> bool, what: &str| {
        let names: Vec<&str> =
            views.iter().zip(facts).filter(|(_, f)| which(f)).map(|(v, _)| v.camera.name.as_str()).collect();
        let more = match names.len().saturating_sub(NAMED_VIEWS) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let list = names.iter().take(NAMED_VIEWS).copied().collect::<Vec<_>>().join(", ");
        (!names.is_empty()).then(|| format!("{what}: {list}{more}."))
    };
    let no_file = named(&|f| !f.has_file, "Views without a file of masks");
    let has_few = |f: &ViewFacts| f.masks().is_some_and(|n| (n as f64) < few);
    no_file.into_iter().chain(named(&has_few, "Views with less than half as many masks as the others")).collect()
}

fn kinds(facts: &[ViewFacts], categories: &BTreeMap<u32, String>) -> Vec<KindOfMasks> {
    let mut by_name: BTreeMap<Option<&String>, (Vec<f64>, BTreeSet<usize>)> = BTreeMap::new();
    for (view, facts) in facts.iter().enumerate() {
        for (id, &part) in &facts.part_of_id {
            let (parts, views) = by_name.entry(categories.get(id)).or_default();
            parts.push(part);
            views.insert(view);
        }
    }
    let kind = |(name, (parts, views)): (Option<&String>, (Vec<f64>, BTreeSet<usize>))| KindOfMasks {
        name: name.cloned(),
        masks: parts.len(),
        views: views.len(),
        median_part: median(&parts),
    };
    by_name.into_iter().map(kind).collect()
}
