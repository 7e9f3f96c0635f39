//! What a run is asked for.

use std::path::PathBuf;

use super::config::RunConfig;
use instgs_io::RunFolder;
use instgs_train::TrainJob;
use instgs_train::config::ConfigError;

/// From which photos and masks a scene is made, how, and where the files go.
#[derive(Clone, Debug)]
pub struct PipelineJob {
    /// Dataset folder.
    pub data: PathBuf,
    /// Run folder.
    pub out: PathBuf,
    /// What to do in every stage.
    pub config: RunConfig,
    /// Go on from what the run folder has.
    pub resume: bool,
}

impl PipelineJob {
    /// The files of the run.
    pub fn folder(&self) -> RunFolder {
        RunFolder::new(&self.out)
    }

    /// The training of the run: of a plain cloud, or, with templates and instances, the joint phase.
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
        })
    }

    /// The first phase of a run with templates and instances, in a folder of its own.
    pub fn cloud_phase(&self) -> Self {
        let out = self.folder().plain_cloud_run().path().into();
        Self { out, config: self.config.cloud_phase(), ..self.clone() }
    }
}
