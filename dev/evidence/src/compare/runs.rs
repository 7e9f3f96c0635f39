//! The training runs of one seed's comparison, each in a folder of its own; what is done is not done again.

use std::path::{Path, PathBuf};

use crate::cli::args::create_folder;
use crate::cli::error::CliError;
use crate::cli::train::{Session, train_job};
use crate::io::IoError;
use crate::io::json::read_json;
use crate::pipeline::makes_scene;
use crate::report::RunReport;
use crate::train::TrainJob;
use crate::train::config::TrainConfig;

/// What one seed's runs share.
pub(in crate::cli) struct Runs<'a> {
    pub(in crate::cli) session: &'a Session<'a>,
    /// Dataset folder.
    pub(in crate::cli) data: &'a Path,
    /// Folder that holds the run folders.
    pub(in crate::cli) out: PathBuf,
    /// Of the instanced run.
    pub(in crate::cli) config: TrainConfig,
}

impl Runs<'_> {
    /// Trains in a folder of its own, or goes on with what is there.
    pub(in crate::cli) fn train(&self, name: &str, config: TrainConfig) -> Result<RunReport, CliError> {
        let out = self.out.join(name);
        let report = out.join("report.json");
        if let Ok(done) = read_json::<RunReport>(&report)
            && done.config == config
        {
            return Ok(done);
        }
        train_job(self.session, &TrainJob { data: self.data.into(), out, config, resume: true })
    }

    /// The plain cloud of the instanced run, trained on for `more` steps, and ended as the joint phase is.
    pub(in crate::cli) fn continued(&self, name: &str, more: u64) -> Result<RunReport, CliError> {
        let (from, to) = (self.out.join("instgs/vanilla"), self.out.join(name));
        if !to.join("config.toml").exists() {
            copy_run(&from, &to)?;
        }
        let steps = self.config.steps + more;
        self.train(name, TrainConfig { steps, ..self.config.cloud_alone() })
    }

    /// An instanced run of other settings that starts from the same plain cloud.
    pub(in crate::cli) fn variant(&self, name: &str, config: TrainConfig) -> Result<RunReport, CliError> {
        let (from, to) = (self.out.join("instgs/vanilla"), self.out.join(name).join("vanilla"));
        create_folder(&to)?;
        // The report last: with it the cloud counts as trained.
        copy_files(&from, &to, ["point_cloud.ply", "events.jsonl", "report.json"].map(String::from))?;
        self.train(name, config)
    }
}

/// What a run is resumed from.
fn copy_run(from: &Path, to: &Path) -> Result<(), CliError> {
    create_folder(&to.join("checkpoints"))?;
    let checkpoints = from.join("checkpoints");
    let newest = crate::io::checkpoint::latest(&checkpoints)?.found;
    let name = newest.as_ref().and_then(|(path, _)| path.file_name()?.to_str());
    let name = name.ok_or_else(|| IoError::new(&checkpoints, "has no checkpoint to go on from"))?;
    // The configuration last: with it the run counts as copied.
    copy_files(from, to, [format!("checkpoints/{name}"), "events.jsonl".into(), "config.toml".into()])
}

fn copy_files(from: &Path, to: &Path, files: impl IntoIterator<Item = String>) -> Result<(), CliError> {
    for file in files {
        let path = from.join(&file);
        std::fs::copy(&path, to.join(&file)).map_err(|e| IoError::new(&path, format!("cannot be copied: {e}")))?;
    }
    Ok(())
}

/// Seconds of training, of making masks, and of what stands between the phases.
pub(in crate::cli) fn work_seconds(report: &RunReport) -> f64 {
    report.stages.iter().filter(|stage| makes_scene(stage)).map(|stage| stage.seconds).sum()
}
