//! Checks whether masks and groups can be used before anything is trained: this takes seconds, training hours.

use rayon::prelude::*;

use instgs_io::{IoError, MaskFolder, View, read_groups};

use super::job::PipelineJob;
use super::label_gaussians::{is_segmented, training_views};
use super::make_masks::check_boxes;
use super::mask_source::MaskSource;

/// Upper bound of the view names in a line; of more views it gives the number.
const NAMED_VIEWS: usize = 3;

/// Reads every mask of a training view, and the groups if the configuration names a file; returns warnings for the
/// user, one line each. Nothing is read if the job resumes with objects that were found already.
///
/// # Errors
/// No masks; a mask that is damaged, has as many colours as a photo, or has another size than its image; masks of which
/// none has an object; boxes of which none can be used; categories or groups that are damaged.
pub fn check_masks(job: &PipelineJob) -> Result<Vec<String>, IoError> {
    if let Some(path) = &job.config.pipeline.groups {
        read_groups(path)?;
    }
    if job.resume && is_segmented(&job.folder()) {
        return Ok(Vec::new());
    }
    let source = MaskSource::of(job)?;
    if let MaskSource::Boxes(path) = &source {
        // Boxes become masks only once there is a cloud.
        return check_boxes(job, path);
    }
    let folder = source.folder(job);
    let (views, _) = training_views(job)?;
    let masks = MaskFolder::open(&folder, &views)?;
    let has_object = |view: &View| -> Result<bool, IoError> {
        Ok(masks.of_view(view)?.is_some_and(|mask| mask.ids.iter().any(|&id| id != 0)))
    };
    // Collected first, so that of several errors the first view's is always returned.
    let found: Vec<Result<bool, IoError>> = views.par_iter().map(has_object).collect();
    let with_object = found.into_iter().collect::<Result<Vec<bool>, IoError>>()?;
    if !with_object.contains(&true) {
        let example = masks
            .any_file()
            .zip(views.first())
            .map(|(mask, view)| format!(" (there is {}, and the first view is {})", mask.display(), view.camera.name));
        let what = format!("no training view has a mask with an object in it{}", example.unwrap_or_default());
        let advice = "a mask has the stem of its view's image, or its whole name, and ids above 0 where objects are";
        return Err(IoError::new(&folder, what).advise(advice));
    }
    let without = without_mask_line(&views_without_mask(&masks, &views)?, views.len());
    let twice = read_twice_line(&masks, &views);
    Ok(masks.notes.into_iter().chain(without).chain(twice).collect())
}

/// A warning if a mask of objects is also a mask of pixels.
fn read_twice_line(masks: &MaskFolder, views: &[View]) -> Option<String> {
    for view in views {
        let Some(of_pixels) = &view.mask_path else { continue };
        // Files of several objects, and masks that are drawn, are no masks of pixels.
        let Ok(Some(of_objects)) = masks.file_of(view) else { continue };
        let whole = |path: &std::path::Path| path.canonicalize().ok();
        if whole(of_objects) == whole(of_pixels) {
            return Some(format!(
                "{}: is used twice: as a mask of ids of objects, and as a mask of pixels, so that only the objects' pixels are \
                 trained on; remove mask_path from the camera file (or leave out --pixel-masks) to train on whole photos, or \
                 name other masks of objects with --masks",
                of_pixels.display()
            ));
        }
    }
    None
}

/// The names of the views that have no mask, in order.
pub(super) fn views_without_mask(masks: &MaskFolder, views: &[View]) -> Result<Vec<String>, IoError> {
    let mut out = Vec::new();
    for view in views {
        if !masks.has_view(view)? {
            out.push(view.camera.name.clone());
        }
    }
    Ok(out)
}

/// A warning if there are views without a mask.
pub(super) fn without_mask_line(names: &[String], views: usize) -> Option<String> {
    let shown = names[..names.len().min(NAMED_VIEWS)].join(", ");
    let more = if names.len() > NAMED_VIEWS { ", ..." } else { "" };
    let count = names.len();
    (count > 0).then(|| {
        format!("{count} of {views} training views have no mask ({shown}{more}); objects are found in the others")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_views_are_named_and_many_counted() {
        let names: Vec<String> = ["a", "b", "c", "d"].map(String::from).into();
        assert_eq!(without_mask_line(&[], 9), None);
        let line = |n: usize| without_mask_line(&names[..n], 9).unwrap_or_default();
        assert!(line(1).starts_with("1 of 9 training views have no mask (a);"), "{}", line(1));
        assert!(line(3).contains("(a, b, c);") && line(4).contains("(a, b, c, ...);"), "{}", line(4));
    }
}
