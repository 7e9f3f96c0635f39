//! What the masks of a run folder were made from: a file beside them, written last. A run that resumes keeps masks only if they
//! are of the same words or boxes.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::config::DetectConfig;
use super::job::PipelineJob;
use super::label_gaussians::print_of;
use super::mask_source::made_masks;
use super::stage_kinds::Stage;
use instgs_io::fingerprint::FilePrint;
use instgs_io::json::{read_json, write_json};
use instgs_io::masks::CATEGORIES;
use instgs_io::{IoError, RunFolder, remove_if_there};
use instgs_train::facts::StageTime;

/// What masks are made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum MaskOrigin {
    /// Words that models detect in the photos, with these settings.
    Words { prompt: String, models: PathBuf, detect: DetectConfig },
    /// A `boxes.json`, by its length and hash, and the plain cloud of the run, by its print.
    Boxes { bytes: u64, hash: String, cloud: Option<String> },
}

impl MaskOrigin {
    /// The origin that the configuration names; `None` if the masks are a folder that was there before.
    fn of(job: &PipelineJob) -> Result<Option<Self>, IoError> {
        let config = &job.config.pipeline;
        Ok(match (&config.prompt, &config.boxes) {
            (Some(prompt), _) => Some(Self::Words {
                prompt: prompt.clone(),
                models: config.models.clone().unwrap_or_default(),
                detect: config.detect.clone(),
            }),
            (None, Some(path)) => {
                let FilePrint { bytes, hash, .. } = FilePrint::of(path)?;
                Some(Self::Boxes { bytes, hash, cloud: print_of(&job.folder().point_cloud()).ok() })
            }
            (None, None) => None,
        })
    }

    /// True for the same words, or the same boxes whatever the cloud.
    fn is_of_same_input(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Boxes { bytes, hash, .. }, Self::Boxes { bytes: of_other, hash: hash_of_other, .. }) => {
                (bytes, hash) == (of_other, hash_of_other)
            }
            _ => self == other,
        }
    }
}

/// What is noted beside the masks that a run has made itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct MadeMasks {
    origin: MaskOrigin,
    /// Remarks on what they were made from, one line each.
    pub(super) notes: Vec<String>,
    /// Wall time of the stage, seconds.
    seconds: f64,
}

impl MadeMasks {
    pub(super) fn path(folder: &RunFolder) -> PathBuf {
        folder.masks().join("made_from.json")
    }

    /// Wall time of the stage.
    pub(super) fn stage(&self) -> StageTime {
        StageTime { name: Stage::Masks.name().into(), seconds: self.seconds }
    }

    /// The masks that a job which resumes can keep; `None` if they are to be made, from the beginning. Those of a version that
    /// did not note their origin are kept if they are complete, without notes.
    ///
    /// # Errors
    /// Boxes that cannot be read; a damaged file beside the masks.
    pub(super) fn kept(job: &PipelineJob) -> Result<Option<Self>, IoError> {
        let (path, folder) = (Self::path(&job.folder()), made_masks(job));
        // The last files of the stage: of boxes the first, of words the second.
        let last = [folder.join(CATEGORIES), folder.join(instgs_detect::BOXES)];
        if let Some(origin) = MaskOrigin::of(job)?.filter(|_| job.resume) {
            if let Some(made) = Self::noted(job)? {
                if made.origin == origin {
                    return Ok(Some(made));
                }
            } else if last[usize::from(matches!(origin, MaskOrigin::Words { .. }))].is_file() {
                return Ok(Some(Self { origin, notes: Vec::new(), seconds: 0.0 }));
            }
        }
        // What is left of others would count as complete if this run is stopped.
        last.iter().chain([&path]).try_for_each(|path| remove_if_there(path))?;
        Ok(None)
    }

    /// What was noted of the masks of the job's folder, whatever they were made from.
    ///
    /// # Errors
    /// A damaged file.
    pub(super) fn noted(job: &PipelineJob) -> Result<Option<Self>, IoError> {
        let path = Self::path(&job.folder());
        if path.is_file() { Ok(Some(read_json(&path)?)) } else { Ok(None) }
    }

    /// Notes what the masks of the job were made from, once they are complete.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub(super) fn write(job: &PipelineJob, notes: &[String], stage: &StageTime) -> Result<(), IoError> {
        let Some(origin) = MaskOrigin::of(job)? else { return Ok(()) };
        write_json(&Self::path(&job.folder()), &Self { origin, notes: notes.to_vec(), seconds: stage.seconds })
    }
}

/// Refuses boxes that are no longer those that the objects of a run were found by.
///
/// # Errors
/// The file of boxes has changed; a damaged file beside the masks.
pub(super) fn check_same_origin(job: &PipelineJob) -> Result<(), IoError> {
    let (Some(boxes), Some(made)) = (&job.config.pipeline.boxes, MadeMasks::noted(job)?) else { return Ok(()) };
    // Boxes that are not there any more are not needed any more.
    let Ok(origin) = MaskOrigin::of(job) else { return Ok(()) };
    if origin.is_some_and(|origin| origin.is_of_same_input(&made.origin)) {
        return Ok(());
    }
    let error = IoError::new(boxes, format!("has changed since the objects of {} were found by it", job.out.display()));
    Err(error.advise("put the old file back, or train into another folder"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::config::ConfigBuilder;

    type Test = Result<(), Box<dyn std::error::Error>>;

    fn job(folder: &std::path::Path) -> Result<PipelineJob, Box<dyn std::error::Error>> {
        let config = ConfigBuilder::new().file("instgs")?.finish()?;
        let out = folder.join("run");
        std::fs::create_dir_all(out.join("masks"))?;
        Ok(PipelineJob { data: folder.into(), out, config, resume: true, accept_changed_data: false })
    }

    #[test]
    fn masks_are_kept_only_with_what_they_were_made_from() -> Test {
        let folder = tempfile::tempdir()?;
        let mut job = job(folder.path())?;
        let stage = StageTime { name: "masks".into(), seconds: 2.0 };
        (job.config.pipeline.prompt, job.config.pipeline.models) = (Some("car.".into()), Some("m".into()));
        assert_eq!(MadeMasks::kept(&job)?, None);
        MadeMasks::write(&job, &["a note".into()], &stage)?;
        let made = MadeMasks::kept(&job)?.ok_or("not kept")?;
        assert_eq!((made.notes.as_slice(), made.stage()), (&["a note".to_owned()][..], stage.clone()));
        job.config.pipeline.prompt = Some("chair.".into());
        assert_eq!(MadeMasks::kept(&job)?, None);
        // And then those of before are gone.
        job.config.pipeline.prompt = Some("car.".into());
        assert_eq!(MadeMasks::kept(&job)?, None);
        // A version without this file: the last file of its stage counts.
        std::fs::write(job.folder().masks().join(instgs_detect::BOXES), "{}")?;
        assert!(MadeMasks::kept(&job)?.is_some());
        job.resume = false;
        assert_eq!(MadeMasks::kept(&job)?, None);
        Ok(())
    }

    #[test]
    fn edited_boxes_are_other_boxes() -> Test {
        let folder = tempfile::tempdir()?;
        let mut job = job(folder.path())?;
        let path = folder.path().join("b.json");
        std::fs::write(&path, "{}")?;
        job.config.pipeline.boxes = Some(path.clone());
        let stage = StageTime { name: "masks".into(), seconds: 2.0 };
        // A word's names are no masks from boxes.
        std::fs::write(job.folder().masks().join(instgs_detect::BOXES), "{}")?;
        assert_eq!(MadeMasks::kept(&job)?, None);
        MadeMasks::write(&job, &[], &stage)?;
        assert!(MadeMasks::kept(&job)?.is_some());
        check_same_origin(&job)?;
        // Of another cloud they are other masks, and the same boxes.
        std::fs::write(job.folder().point_cloud(), "ply")?;
        check_same_origin(&job)?;
        assert_eq!(MadeMasks::kept(&job)?, None);
        MadeMasks::write(&job, &[], &stage)?;
        assert!(MadeMasks::kept(&job)?.is_some());
        std::fs::write(&path, "{} ")?;
        let error = check_same_origin(&job).err().ok_or("taken")?.to_string();
        assert!(error.contains("b.json") && error.contains("has changed"), "{error}");
        assert_eq!(MadeMasks::kept(&job)?, None);
        // Without the file a run whose objects are found goes on.
        MadeMasks::write(&job, &[], &stage)?;
        std::fs::remove_file(&path)?;
        check_same_origin(&job)?;
        Ok(())
    }
}
