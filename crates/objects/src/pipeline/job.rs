//! The job of a pipeline run.

use std::path::PathBuf;

use super::config::RunConfig;
use instgs_io::{IoError, RunFolder};
use instgs_train::TrainJob;
use instgs_train::config::ConfigError;

/// Photos and masks to make a scene from, the configuration, and the folder of the results.
#[derive(Clone, Debug)]
pub struct PipelineJob {
    /// Folder of the data set.
    pub data: PathBuf,
    /// Run folder to write.
    pub out: PathBuf,
    /// Configuration of all stages.
    pub config: RunConfig,
    /// Whether to continue from the files that the run folder has.
    pub resume: bool,
    /// Whether to continue although photos, masks of pixels or cameras are not those that the run began with.
    pub accept_changed_data: bool,
}

impl PipelineJob {
    /// The files of the run folder.
    pub fn folder(&self) -> RunFolder {
        RunFolder::new(&self.out)
    }

    /// Fails if a new run would write among the photos: `groups.json` and `masks/` are names that data sets use as well. A run that
    /// has begun there goes on.
    ///
    /// # Errors
    /// The run folder is the data set's, or a file.
    pub fn check_folders(&self) -> Result<(), IoError> {
        if self.out.is_file() {
            return Err(IoError::new(&self.out, "is a file, and a run needs a folder").advise("choose another --out"));
        }
        let [data, out] = [&self.data, &self.out].map(|path| path.canonicalize().ok());
        let goes_on = self.resume && self.folder().trace_of_run().is_some();
        if data.is_some() && data == out && !goes_on {
            let error = IoError::new(&self.out, "is the folder of the data set, whose files a run would replace");
            return Err(error.advise("choose another folder for the run, for instance one in it"));
        }
        Ok(())
    }

    /// The training job of the run: of a plain cloud, or, with templates and instances, of the joint phase.
    ///
    /// # Errors
    /// A configuration that cannot be written down.
    pub fn training(&self) -> Result<TrainJob, ConfigError> {
        Ok(TrainJob {
            data: self.data.clone(),
            out: self.out.clone(),
            config: self.config.train.clone(),
            config_file: Some(self.config.to_toml()?),
            resume: self.resume,
            accept_changed_data: self.accept_changed_data,
        })
    }

    /// The job of the first phase of a run with templates and instances, in a folder of its own.
    pub fn cloud_phase(&self) -> Self {
        let out = self.folder().plain_cloud_run().path().into();
        Self { out, config: self.config.cloud_phase(), ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::config::ConfigBuilder;

    #[test]
    fn a_run_is_not_written_among_the_photos() -> Result<(), Box<dyn std::error::Error>> {
        let data = tempfile::tempdir()?;
        let job = |out: PathBuf| -> Result<PipelineJob, Box<dyn std::error::Error>> {
            let config = ConfigBuilder::new().finish()?;
            Ok(PipelineJob { data: data.path().into(), out, config, resume: false, accept_changed_data: false })
        };
        assert!(job(data.path().join("."))?.check_folders().is_err());
        assert!(job(data.path().join("runs/a"))?.check_folders().is_ok());
        std::fs::create_dir(data.path().join("run"))?;
        assert!(job(data.path().join("run"))?.check_folders().is_ok());
        assert!(job(data.path().join("run/.."))?.check_folders().is_err());
        let begun = PipelineJob { resume: true, ..job(data.path().into())? };
        assert!(begun.check_folders().is_err());
        std::fs::create_dir(data.path().join("vanilla"))?;
        assert!(begun.check_folders().is_ok() && job(data.path().into())?.check_folders().is_err());
        Ok(())
    }
}
