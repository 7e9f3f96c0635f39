//! Masks that a run makes for itself: from words before the plain cloud is trained.

use std::time::Instant;

use super::error::TrainError;
use super::mask_source::{MaskSource, made_masks};
use super::report::Stage;
use super::segmented::{stage, training_views};
use super::trainer::TrainJob;
use crate::detect::{self, Prompt, PromptReport, ViewMasks};
use crate::io::View;

/// What was found by name, and how long it took.
pub struct FoundByName {
    /// What was found.
    pub report: PromptReport,
    /// Wall time.
    pub stage: Stage,
}

/// Finds what the job's prompt names in the photos of its training views, and leaves masks in the run folder; `done` is told
/// of each view, with the number of all. `None` if the masks come from elsewhere, or are there and the job resumes.
///
/// # Errors
/// Models or the runtime library that are missing; a photo that cannot be read; nothing found at all.
pub fn masks_from_prompt(
    job: &TrainJob,
    done: &mut dyn FnMut(&str, &ViewMasks, usize),
) -> Result<Option<FoundByName>, TrainError> {
    let MaskSource::Prompt { prompt, models } = MaskSource::of(job)? else { return Ok(None) };
    let out = made_masks(job);
    // Written last.
    if job.resume && out.join(detect::BOXES).is_file() {
        return Ok(None);
    }
    let started = Instant::now();
    let (views, _) = training_views(job)?;
    let views: Vec<&View> = views.iter().collect();
    let (prompt, options, total) = (Prompt::parse(&prompt)?, job.config.detect.options(), views.len());
    let mut done = |name: &str, view: &ViewMasks| done(name, view, total);
    let report = detect::masks_from_prompt(&views, &prompt, &models, &options, &out, &mut done)?;
    Ok(Some(FoundByName { report, stage: stage("masks", started) }))
}
