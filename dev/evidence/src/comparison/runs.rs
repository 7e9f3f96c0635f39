//! The training runs of one seed's comparison, each in a folder of its own; finished runs are not repeated.

use std::path::{Path, PathBuf};

use crate::protocol::Measure;
use instgs_cli::training::{Session, train_job};
use instgs_console::CliError;
use instgs_console::args::create_folder;
use instgs_eval::Lpips;
use instgs_io::json::read_json;
use instgs_io::{IoError, MaskFolder, RunFolder, View, copy_file};
use instgs_objects::pipeline::config::RunConfig;
use instgs_objects::pipeline::{PipelineJob, makes_scene};
use instgs_report::RunReport;
use instgs_train::{USUAL_PICTURE_PSNR_DB, check_finished, eval_options, sensitivity_cameras, write_small};
use instgs_vk::scene::InstancedScene;

/// The inputs that one seed's runs share.
pub(crate) struct Runs<'a> {
    pub(crate) session: &'a Session<'a>,
    /// Folder of the data set.
    pub(crate) data: &'a Path,
    /// Folder that holds the run folders.
    pub(crate) out: PathBuf,
    /// Configuration of the instanced run.
    pub(crate) config: RunConfig,
}

/// What scenes are measured on.
pub(crate) struct Seen<'a> {
    /// The test views.
    pub(crate) views: &'a [View],
    /// Their masks, of [`Runs::masks`].
    pub(crate) masks: Option<&'a MaskFolder>,
    /// Network of LPIPS, if its weights are there.
    pub(crate) lpips: Option<&'a Lpips>,
}

impl Runs<'_> {
    /// The run folder of the given name.
    pub(crate) fn folder(&self, name: &str) -> RunFolder {
        RunFolder::new(self.out.join(name))
    }

    /// Writes a scene as `NAME.instgs`, packed small for the training views at the size they are trained at.
    pub(crate) fn write_small(&self, name: &str, scene: &InstancedScene) -> Result<PathBuf, CliError> {
        let file = self.out.join(format!("{name}.instgs"));
        let mut cameras = sensitivity_cameras(self.data)?;
        let width = self.config.train.width;
        for camera in cameras.iter_mut().filter(|camera| (1..camera.width).contains(&width)) {
            let height = f64::from(camera.height) * f64::from(width) / f64::from(camera.width);
            *camera = camera.resized(width, (height.round() as u32).max(1));
        }
        write_small(self.session.gpu, &file, scene, &cameras, USUAL_PICTURE_PSNR_DB)?;
        Ok(file)
    }

    /// The masks of the views' objects, if there are any.
    pub(crate) fn masks(&self, views: &[View]) -> Result<Option<MaskFolder>, IoError> {
        let folder = self.config.pipeline.masks.clone().or_else(|| MaskFolder::default_for(self.data));
        folder.map(|folder| MaskFolder::open(&folder, views)).transpose()
    }

    /// How every scene of the comparison is measured, ablations included.
    pub(crate) fn measure<'a>(&'a self, seen: Seen<'a>) -> Measure<'a> {
        let Seen { views, masks, lpips } = seen;
        let width = (self.config.train.width > 0).then_some(self.config.train.width);
        Measure { gpu: self.session.gpu, views, width, options: eval_options(&self.config.train), masks, lpips }
    }

    /// Trains in a folder of its own, or resumes the run there.
    pub(crate) fn train(&self, name: &str, config: RunConfig) -> Result<RunReport, CliError> {
        let folder = self.folder(name);
        let done = read_json::<RunReport>(&folder.report()).ok().filter(|done| done.config == config);
        let job = PipelineJob {
            data: self.data.into(),
            out: folder.path().into(),
            config,
            resume: true,
            accept_changed_data: false,
        };
        match done {
            Some(done) => {
                // Of these photos, not of others that were here before.
                check_finished(&job.training()?)?;
                Ok(done)
            }
            None => train_job(self.session, &job),
        }
    }

    /// The plain cloud of the instanced run, trained on for `more` steps, with rates that end like the joint phase's.
    pub(crate) fn continued(&self, name: &str, more: u64) -> Result<RunReport, CliError> {
        let (from, to) = (self.folder("instgs").plain_cloud_run(), self.folder(name));
        if !to.config().exists() {
            copy_run(&from, &to)?;
        }
        let mut config = self.config.cloud_alone();
        config.train.steps = self.config.train.steps + more;
        self.train(name, config)
    }

    /// An instanced run with other settings that starts from the same plain cloud.
    pub(crate) fn variant(&self, name: &str, config: RunConfig) -> Result<RunReport, CliError> {
        let (from, to) = (self.folder("instgs").plain_cloud_run(), self.folder(name).plain_cloud_run());
        to.create()?;
        copy_file(&from.point_cloud(), &to.point_cloud())?;
        copy_file(&from.events(), &to.events())?;
        copy_file(&from.report(), &to.report())?;
        if from.exposures().is_file() {
            copy_file(&from.exposures(), &to.exposures())?;
        }
        // Copied last: with this file the cloud counts as trained. Older versions wrote none.
        if from.facts().is_file() {
            copy_file(&from.facts(), &to.facts())?;
        }
        self.train(name, config)
    }
}

/// Copies the files that a run is resumed from.
fn copy_run(from: &RunFolder, to: &RunFolder) -> Result<(), CliError> {
    let checkpoints = from.checkpoints();
    create_folder(&to.checkpoints())?;
    let newest = instgs_io::checkpoint::latest(&checkpoints)?.found;
    let newest = newest.as_ref().and_then(|(path, _)| Some((path, path.file_name()?)));
    let (path, name) = newest.ok_or_else(|| IoError::new(&checkpoints, "has no checkpoint to go on from"))?;
    copy_file(path, &to.checkpoints().join(name))?;
    copy_file(&from.events(), &to.events())?;
    // Copied last: with this file the run counts as copied.
    Ok(copy_file(&from.config(), &to.config())?)
}

/// Seconds of training, of making masks, and of the stages between the phases.
pub(crate) fn work_seconds(report: &RunReport) -> f64 {
    report.stages.iter().filter(|stage| makes_scene(stage)).map(|stage| stage.seconds).sum()
}
