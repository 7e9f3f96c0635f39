//! Masks that a run makes itself: from words before the plain cloud is trained, from boxes after it.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use super::error::PipelineError;
use super::job::PipelineJob;
use super::label_gaussians::{are_of_another_cloud, is_segmented, training_views};
use super::made_masks::MadeMasks;
use super::mask_source::{MaskSource, made_masks};
use super::observer::{Message, Observer};
use super::stage_kinds::Stage;
use crate::segment::boxes::{BoxOptions, BoxReport, masks_from_boxes as draw, usable_boxes};
use instgs_detect::{Prompt, ViewMasks};
use instgs_io::masks::CATEGORIES;
use instgs_io::{Dataset, IoError, Split, View, read_boxes, with_view_names, write_categories, write_mask};
use instgs_train::eval_options;
use instgs_train::facts::StageTime;
use instgs_train::read_dataset;
use instgs_vk::gpu::Gpu;
use instgs_vk::scene::{Boxes, InstancedScene};

/// Detects what the job's prompt names in the photos of its training views, and writes masks to the run folder;
/// `observer` receives each view and a summary. Returns the wall time; `None` if the masks come from elsewhere. A job that
/// resumes keeps masks that were made from the same words with the same settings.
///
/// # Errors
/// Models or the runtime library that are missing; a photo that cannot be read; no detection in any photo.
pub fn masks_from_prompt(job: &PipelineJob, observer: &mut dyn Observer) -> Result<Option<StageTime>, PipelineError> {
    let MaskSource::Prompt { prompt, models } = MaskSource::of(job)? else { return Ok(None) };
    if has_served(job) {
        return Ok(MadeMasks::noted(job)?.map(|made| made.stage()));
    }
    if let Some(made) = MadeMasks::kept(job)? {
        return Ok(Some(made.stage()));
    }
    let out = made_masks(job);
    let clock = Stage::Masks.begin(observer)?;
    let (views, _) = training_views(job)?;
    let photos: Vec<&View> = views.iter().collect();
    let (prompt, options) = (Prompt::parse(&prompt)?, job.config.pipeline.detect.options());
    let mut told = Ok(());
    let mut done = |name: &str, found: &ViewMasks| {
        if told.is_ok() {
            told = observer.notify(Message::ViewMasked { name, found, views: views.len() });
        }
    };
    let report = instgs_detect::masks_from_prompt(&photos, &prompt, &models, &options, &out, &mut done)?;
    MadeMasks::write(job, &[], &clock.time())?;
    told?;
    observer.notify(Message::NamesFound(&report))?;
    Ok(Some(clock.end(observer)?))
}

/// True if the objects of a job that resumes are found: what they were made from is not needed any more.
fn has_served(job: &PipelineJob) -> bool {
    job.resume && is_segmented(&job.folder()) && !are_of_another_cloud(&job.folder())
}

/// Result of the masks from boxes.
pub(super) struct FoundByBoxes {
    /// Remarks on the boxes, one line each for the user.
    pub(super) notes: Vec<String>,
    /// Wall time of the stage.
    pub(super) stage: StageTime,
}

/// Makes the masks of a job with boxes from its plain cloud. `None` if the masks come from elsewhere. A job that resumes keeps
/// masks that were made from the same boxes.
///
/// # Errors
/// The same errors as [`training_boxes`] and [`write_masks_from_boxes`].
pub(super) fn masks_from_boxes(
    gpu: &Arc<Gpu>,
    job: &PipelineJob,
    cloud: &InstancedScene,
    observer: &mut dyn Observer,
) -> Result<Option<FoundByBoxes>, PipelineError> {
    let MaskSource::Boxes(path) = MaskSource::of(job)? else { return Ok(None) };
    let found = |made: MadeMasks| FoundByBoxes { stage: made.stage(), notes: made.notes };
    if has_served(job) {
        return Ok(MadeMasks::noted(job)?.map(found));
    }
    if let Some(made) = MadeMasks::kept(job)? {
        return Ok(Some(found(made)));
    }
    let clock = Stage::Masks.begin(observer)?;
    let (views, _) = training_views(job)?;
    let (boxes, options) = (training_boxes(job, &path)?, box_options(job));
    let report = write_masks_from_boxes(gpu, cloud, &views, &boxes, &options, &made_masks(job), observer)?;
    MadeMasks::write(job, &report.notes, &clock.time())?;
    Ok(Some(FoundByBoxes { notes: report.notes, stage: clock.end(observer)? }))
}

fn box_options(job: &PipelineJob) -> BoxOptions {
    BoxOptions {
        width: (job.config.train.width > 0).then_some(job.config.train.width),
        seed: job.config.train.seed,
        render: eval_options(&job.config.train),
        ..BoxOptions::default()
    }
}

/// Checks the boxes of a job before it has a cloud; returns warnings for the user, one line each.
///
/// # Errors
/// A file that is missing or damaged, or boxes of which none can be used.
pub(super) fn check_boxes(job: &PipelineJob, path: &Path) -> Result<Vec<String>, IoError> {
    let boxes = training_boxes(job, path)?;
    let (views, _) = training_views(job)?;
    usable_boxes(&views, &boxes, &box_options(job)).map_err(|e| {
        let advice =
            "instgs-vk masks --boxes with --out draws what becomes of boxes; docs/guide.md says how they are given";
        IoError::new(path, e.to_string()).advise(advice)
    })
}

/// Reads the boxes that a job's masks are made from. Boxes in photos of test views are left out: training must not know
/// their contents.
///
/// # Errors
/// A file that is missing or damaged; no box in the world or in a training view.
pub(super) fn training_boxes(job: &PipelineJob, path: &Path) -> Result<Boxes, IoError> {
    let dataset = read_dataset(&job.data, &job.config.train)?;
    let boxes = with_view_names(read_boxes(path)?, &dataset.views);
    let is_of_training = |name: &String| dataset.split(Split::Train).any(|view| view.camera.name == *name);
    if boxes.objects.is_empty() && !boxes.views.keys().any(is_of_training) {
        let error = IoError::new(path, "has no box in the world and none in a photo of a training view");
        return Err(error.advise("a view has the name of its photo without the file extension"));
    }
    Ok(without_test_views(boxes, &dataset))
}

/// Boxes in photos that are not in the data set stay: a warning about them follows.
fn without_test_views(mut boxes: Boxes, dataset: &Dataset) -> Boxes {
    let test_views: BTreeSet<&str> = dataset.split(Split::Test).map(|view| view.camera.name.as_str()).collect();
    boxes.views.retain(|name, _| !test_views.contains(name.as_str()));
    boxes
}

/// Makes masks of all `views` from boxes and a plain cloud, and writes them with their `categories.json`, which comes
/// last, into the folder `out`. `observer` receives the numbers of views done and in all.
///
/// # Errors
/// Boxes of which none is in a view, a cloud too large for the device, or a file that cannot be written.
pub fn write_masks_from_boxes(
    gpu: &Arc<Gpu>,
    cloud: &InstancedScene,
    views: &[View],
    boxes: &Boxes,
    options: &BoxOptions,
    out: &Path,
    observer: &mut dyn Observer,
) -> Result<BoxReport, PipelineError> {
    instgs_io::run_folder::create(out)?;
    let found = draw::<PipelineError>(
        gpu,
        cloud,
        views,
        boxes,
        options,
        |view, mask| Ok(write_mask(&out.join(format!("{}.png", views[view].camera.name)), mask)?),
        |at| Ok(observer.notify(Message::Labelling(at))?),
    )?;
    write_categories(&out.join(CATEGORIES), &found.categories)?;
    Ok(found.report)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use glam::DVec3;

    use super::*;
    use instgs_vk::scene::{Camera, ViewBox};

    fn view(name: &str, split: Split) -> View {
        let camera = Camera::look_at(name, DVec3::NEG_Y, DVec3::ZERO, DVec3::Z, 0.8, (16, 8));
        View { camera, image_path: PathBuf::new(), split, distortion: None, mask_path: None }
    }

    /// Boxes in photos of test views are recognised and not used.
    #[test]
    fn boxes_of_test_views_are_left_out() {
        let dataset = Dataset { views: vec![view("a", Split::Test), view("b", Split::Train)], notes: Vec::new() };
        let of = |names: &[&str]| {
            let one = ViewBox { id: None, category: None, score: None, box_px: [0.0, 0.0, 4.0, 4.0] };
            let views = names.iter().map(|name| (name.to_string(), vec![one.clone()])).collect();
            Boxes { views, ..Boxes::default() }
        };
        assert_eq!(without_test_views(of(&["a", "b", "nowhere"]), &dataset), of(&["b", "nowhere"]));
        assert_eq!(without_test_views(of(&["a"]), &dataset), of(&[]));
    }
}
