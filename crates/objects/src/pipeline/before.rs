//! A command that fails before it has results leaves the run folder as it was.

use std::path::PathBuf;
use std::time::SystemTime;

use super::job::PipelineJob;
use super::label_gaussians::print_of;
use super::made_masks::MadeMasks;
use instgs_io::{IoError, atomic_write, read_bytes, remove_if_there};

/// What a run folder held before its configuration was replaced.
pub(super) struct Before {
    /// Its configuration, if it had one.
    config: Option<Vec<u8>>,
    results: Results,
}

impl Before {
    /// Notes what the job's folder holds.
    ///
    /// # Errors
    /// The configuration cannot be read.
    pub(super) fn of(job: &PipelineJob) -> Result<Self, IoError> {
        let config = Some(job.folder().config()).filter(|file| file.is_file());
        Ok(Self { config: config.map(|file| read_bytes(&file)).transpose()?, results: Results::of(job) })
    }

    /// After an error: gives the folder the configuration back that it had, unless there are results of the new one. What was
    /// refused is then as if it had not been asked for. If that fails as well, the first error is the one to report.
    pub(super) fn restore(self, job: &PipelineJob) {
        if Results::of(job).add_to(&self.results) {
            return;
        }
        let file = job.folder().config();
        let Some(bytes) = self.config else {
            let cloud = job.cloud_phase().folder();
            // What the plain cloud's phase makes before its first checkpoint.
            for begun in [cloud.config(), cloud.events()] {
                let _ = remove_if_there(&begun);
            }
            for folder in [cloud.checkpoints().as_path(), cloud.path()] {
                let _ = std::fs::remove_dir(folder);
            }
            // A folder that still looks like a run's needs its configuration.
            if !cloud.path().exists() {
                let _ = remove_if_there(&file);
            }
            return;
        };
        let _ = atomic_write(&file, |out| out.write_all(&bytes));
    }
}

/// What phases and stages have left in a run folder.
struct Results {
    /// Checkpoints of both phases, and when they were written.
    written: Vec<(PathBuf, SystemTime)>,
    /// Prints of the stages' files, of those that are there: a file that is written again as it was is no new result.
    prints: Vec<Option<String>>,
}

impl Results {
    fn of(job: &PipelineJob) -> Self {
        let (run, cloud) = (job.folder(), job.cloud_phase().folder());
        let folders = [run.checkpoints(), cloud.checkpoints()];
        let files = folders.iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
        let time_of =
            |file: std::fs::DirEntry| Some((file.path(), file.metadata().and_then(|data| data.modified()).ok()?));
        let written = files.filter_map(time_of).collect();
        let stages = [
            run.point_cloud(),
            run.consensus(),
            run.labels(),
            run.groups(),
            run.registration(),
            run.initial_scene(),
            run.prepared(),
            // The last file of masks that were made.
            MadeMasks::path(&run),
        ];
        Self { written, prints: stages.iter().map(|file| print_of(file).ok()).collect() }
    }

    /// True if there is anything that was not there; what was removed since is no result.
    fn add_to(&self, before: &Self) -> bool {
        self.written.iter().any(|file| !before.written.contains(file))
            || self.prints.iter().zip(&before.prints).any(|(now, was)| now.is_some() && now != was)
    }
}
