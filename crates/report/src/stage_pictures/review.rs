//! Paints every view with its masks, for `review_page`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use rayon::prelude::*;

use super::colors::Colors;
use super::inputs::consensus_notes;
use super::masks::{Paint, painted};
use super::{VIEW_WIDTH_PX, object_paint, photo};
use crate::{KindOfMasks, ObjectColor, PictureError, ReviewSheet, ReviewView, write_review};
use instgs_io::view_image::camera_at_width;
use instgs_io::{IoError, Mask, MaskFolder, View};
use instgs_objects::segment::Consensus;
use instgs_vk::math::statistics::median;

/// Upper bound of the view names in a line; of more views it gives the number.
const NAMED_VIEWS: usize = 5;
/// Views with fewer masks than this fraction of the median are named: a detector has probably missed objects there.
const FEW_MASKS: f64 = 0.5;

/// Host bytes that photos may take while they are decoded: one large photo per core could be tens of gigabytes.
const PHOTO_BYTES: u64 = 2 << 30;
/// Host bytes per pixel while decoding: 16 for the photo, 2 for its mask, and 2 more while the mask is read.
const BYTES_PER_PIXEL: u64 = 20;

/// Writes the contact sheet of the masks of `views`; with `found`, the objects of consensus too: `views` are then those
/// that consensus was computed from.
///
/// # Errors
/// A mask or a photo that is missing or damaged, or a file that cannot be written.
pub fn review(out: &Path, views: &[View], masks: &MaskFolder, found: Option<&Consensus>) -> Result<(), IoError> {
    write_review(out, &sheet(views, masks, found)?)
}

fn sheet(views: &[View], masks: &MaskFolder, found: Option<&Consensus>) -> Result<ReviewSheet, IoError> {
    let facts = views.par_iter().map(|view| ViewFacts::of(view, masks)).collect::<Vec<_>>();
    let facts = facts.into_iter().collect::<Result<Vec<_>, IoError>>()?;
    let given = Colors::of_ids(facts.iter().flat_map(|f| f.part_of_id.keys().copied()));
    let objects = found.map(|found| Colors::of_ids(found.report.objects.iter().map(|object| object.id)));
    let draw = |index: usize| -> Result<ReviewView, IoError> {
        let view = &views[index];
        let pictures = pictures(index, view, masks, &given, found.zip(objects.as_ref()))?;
        Ok(ReviewView { name: view.camera.name.clone(), masks: facts[index].masks(), pictures })
    };
    let indices: Vec<usize> = (0..views.len()).collect();
    let at_a_time = |some: &[usize]| some.par_iter().map(|&index| draw(index)).collect::<Vec<_>>();
    let drawn: Vec<_> = indices.chunks(photos_at_a_time(views)).flat_map(at_a_time).collect();
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

/// Number of photos that may be decoded at a time.
fn photos_at_a_time(views: &[View]) -> usize {
    let pixels = |view: &View| u64::from(view.camera.width) * u64::from(view.camera.height);
    let largest = views.iter().map(pixels).max().unwrap_or(0).max(1);
    usize::try_from(PHOTO_BYTES / (BYTES_PER_PIXEL * largest)).unwrap_or(usize::MAX).max(1)
}

/// The contents of a view's mask.
struct ViewFacts {
    has_file: bool,
    /// By mask id: the fraction of the picture, 0..=1.
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
) -> Result<Vec<(&'static str, String)>, IoError> {
    // A photo smaller than that is not enlarged: the page scales it.
    let photo = photo(view, &camera_at_width(&view.camera, Some(VIEW_WIDTH_PX.min(view.camera.width))))?;
    let fail = |error: PictureError| IoError::new(&view.image_path, error.to_string());
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rgb8;
    use instgs_io::{Split, write_categories, write_mask};
    use instgs_objects::segment::{ConsensusReport, IdTable, ObjectReport};
    use instgs_vk::scene::Camera;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    const SIZE: u32 = 16;

    fn view(folder: &Path, name: &str) -> Result<View, Box<dyn std::error::Error>> {
        let image_path = folder.join(format!("{name}.png"));
        let pixels = vec![128; (3 * SIZE * SIZE) as usize];
        std::fs::write(&image_path, Rgb8 { width: SIZE, height: SIZE, pixels }.png()?)?;
        let view_from_world = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let name = name.into();
        let camera = Camera { name, width: SIZE, height: SIZE, fx: 9.0, fy: 9.0, cx: 8.0, cy: 8.0, view_from_world };
        Ok(View { camera, image_path, split: Split::Train, distortion: None, mask_path: None })
    }

    /// A mask with one row of pixels for each id.
    fn masked(folder: &Path, name: &str, ids: &[u16]) -> Outcome {
        let rows = (0..SIZE as usize).flat_map(|y| [ids.get(y).copied().unwrap_or_default(); SIZE as usize]);
        let mask = Mask { width: SIZE, height: SIZE, ids: rows.collect() };
        Ok(write_mask(&folder.join("masks").join(format!("{name}.png")), &mask)?)
    }

    #[test]
    fn the_sheet_counts_masks_and_names_views_that_lack_them() -> Outcome {
        let folder = tempfile::tempdir()?;
        let at = folder.path();
        std::fs::create_dir(at.join("masks"))?;
        let views = ["a", "b", "c", "d"].map(|name| view(at, name));
        let views = views.into_iter().collect::<Result<Vec<_>, _>>()?;
        masked(at, "a", &[1, 2, 3])?;
        masked(at, "b", &[4, 5, 6, 6])?;
        masked(at, "c", &[1])?;
        write_categories(&at.join("masks/categories.json"), &[(1, "car".to_owned()), (6, "car".to_owned())].into())?;
        let masks = MaskFolder::open(&at.join("masks"), &views)?;
        let sheet = sheet(&views, &masks, None)?;
        assert_eq!(sheet.views.iter().map(|v| v.masks).collect::<Vec<_>>(), [Some(3), Some(3), Some(1), None]);
        assert_eq!(sheet.warnings.len(), 2, "{:?}", sheet.warnings);
        assert!(sheet.warnings[0].contains("without a file") && sheet.warnings[0].ends_with(": d."));
        assert!(sheet.warnings[1].contains("half as many") && sheet.warnings[1].ends_with(": c."));
        let kinds: Vec<_> = sheet.kinds.iter().map(|k| (k.name.as_deref(), k.masks, k.views, k.median_part)).collect();
        assert_eq!(kinds, [(None, 4, 2, 1.0 / 16.0), (Some("car"), 3, 3, 1.0 / 16.0)]);
        let captions = |v: usize| sheet.views[v].pictures.iter().map(|(caption, _)| *caption).collect::<Vec<_>>();
        assert_eq!((captions(0), captions(3)), (vec!["masks as given"], vec!["photograph"]));
        assert!(sheet.notes[0].starts_with("3 of 4 views have masks: 1 to 3"), "{}", sheet.notes[0]);
        Ok(())
    }

    #[test]
    fn with_the_consensus_every_view_shows_both() -> Outcome {
        let folder = tempfile::tempdir()?;
        let at = folder.path();
        std::fs::create_dir(at.join("masks"))?;
        let views = vec![view(at, "a")?, view(at, "b")?];
        masked(at, "a", &[1; 16])?;
        masked(at, "b", &[2; 16])?;
        let masks = MaskFolder::open(&at.join("masks"), &views)?;
        let found = Consensus {
            table: IdTable::PerView(vec![[(1, 7)].into(), [(2, 7)].into()]),
            report: ConsensusReport {
                masks: 2,
                objects: vec![ObjectReport { id: 7, ..ObjectReport::default() }],
                ..ConsensusReport::default()
            },
        };
        let sheet = sheet(&views, &masks, Some(&found))?;
        let [a, b] = [0, 1].map(|v| &sheet.views[v].pictures);
        assert_eq!((a.len(), b.len(), sheet.colors.len()), (2, 2, 1));
        assert!(a[0].1 != b[0].1, "ids differ");
        assert!(a[1].1 == b[1].1, "the object is the same");
        review(&at.join("review.html"), &views, &masks, Some(&found))?;
        assert!(std::fs::read_to_string(at.join("review.html"))?.contains("joined to 1 objects"));
        std::fs::remove_file(at.join("a.png"))?;
        assert!(review(&at.join("review.html"), &views, &masks, None).is_err_and(|e| e.to_string().contains("a.png")));
        Ok(())
    }
}
