//! The source of a run's masks: a folder, boxes and the plain cloud, or words and models.

use std::path::PathBuf;

use super::job::PipelineJob;
use instgs_io::{IoError, MaskFolder};

/// The source of a run's masks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MaskSource {
    /// A folder of masks that exists.
    Folder(PathBuf),
    /// Boxes in this `boxes.json`, once the plain cloud is trained.
    Boxes(PathBuf),
    /// Detection in the photos, by the models in a folder, before anything is trained.
    Prompt {
        /// What to detect, phrases that end in full stops.
        prompt: String,
        /// Folder of the models.
        models: PathBuf,
    },
}

impl MaskSource {
    /// The source that the configuration names: at most one of masks, boxes and prompt; without any, the data set's own
    /// masks.
    ///
    /// # Errors
    /// More than one source, a prompt without models, or no masks at all.
    pub fn of(job: &PipelineJob) -> Result<Self, IoError> {
        let config = &job.config.pipeline;
        let fail = |what: String, advice: &str| Err(IoError::new(&job.data, what).advise(advice));
        match (&config.masks, &config.boxes, &config.prompt) {
            (Some(folder), None, None) => Ok(Self::Folder(folder.clone())),
            (None, Some(boxes), None) => Ok(Self::Boxes(boxes.clone())),
            (None, None, Some(prompt)) => match &config.models {
                Some(models) => Ok(Self::Prompt { prompt: prompt.clone(), models: models.clone() }),
                None => fail(
                    format!("\"{prompt}\" cannot be detected without models"),
                    "give their folder with --models; tools/models/README.md says how to make it",
                ),
            },
            (None, None, None) => match MaskFolder::default_for(&job.data) {
                Some(folder) => Ok(Self::Folder(folder)),
                None => fail(
                    "has no masks".into(),
                    "put one PNG of object ids per image into masks/, give their folder with --masks, or have them made \
                     with --prompt or --boxes",
                ),
            },
            (masks, boxes, prompt) => {
                let named = [("masks", masks.is_some()), ("boxes", boxes.is_some()), ("prompt", prompt.is_some())];
                let named: Vec<&str> =
                    named.into_iter().filter_map(|(key, is_given)| is_given.then_some(key)).collect();
                fail(format!("has masks from {} at once", named.join(" and ")), "leave all but one of them empty")
            }
        }
    }

    /// The folder of the masks, which may not exist yet.
    pub(super) fn folder(&self, job: &PipelineJob) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.clone(),
            Self::Boxes(_) | Self::Prompt { .. } => made_masks(job),
        }
    }
}

/// The folder of masks that a run makes itself.
pub(super) fn made_masks(job: &PipelineJob) -> PathBuf {
    job.folder().masks()
}

/// The folder of a job's masks.
///
/// # Errors
/// The same errors as [`MaskSource::of`].
pub fn mask_folder(job: &PipelineJob) -> Result<PathBuf, IoError> {
    Ok(MaskSource::of(job)?.folder(job))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::config::ConfigBuilder;

    #[test]
    fn masks_come_from_one_source() -> Result<(), Box<dyn std::error::Error>> {
        let data = tempfile::tempdir()?;
        let mut job = PipelineJob {
            data: data.path().into(),
            out: "run".into(),
            config: ConfigBuilder::new().file("instgs")?.finish()?,
            resume: false,
            accept_changed_data: false,
        };
        let text = |job: &PipelineJob| MaskSource::of(job).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text(&job).contains("has no masks") && text(&job).contains("--prompt"), "{}", text(&job));
        std::fs::create_dir(data.path().join("masks"))?;
        assert_eq!(MaskSource::of(&job)?, MaskSource::Folder(data.path().join("masks")));
        job.config.pipeline.boxes = Some("b.json".into());
        assert_eq!(MaskSource::of(&job)?, MaskSource::Boxes("b.json".into()));
        assert_eq!(mask_folder(&job)?, PathBuf::from("run/masks"));
        job.config.pipeline.prompt = Some("car.".into());
        assert!(text(&job).contains("boxes and prompt"), "{}", text(&job));
        job.config.pipeline.boxes = None;
        assert!(text(&job).contains("--models"), "{}", text(&job));
        job.config.pipeline.models = Some("m".into());
        assert!(matches!(MaskSource::of(&job)?, MaskSource::Prompt { .. }));
        job.config.pipeline.masks = Some("x".into());
        assert!(text(&job).contains("masks and prompt"), "{}", text(&job));
        Ok(())
    }
}
