//! A whole run: a plain cloud alone, or all phases up to the joint phase. Every stage leaves files in the run folder,
//! and a job that resumes continues after the last finished stage.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use super::before::Before;
use super::check_masks;
use super::config::{ConfigBuilder, RunConfig};
use super::error::PipelineError;
use super::job::PipelineJob;
use super::label_gaussians::is_segmented;
use super::made_masks::check_same_origin;
use super::make_masks::masks_from_prompt;
use super::mask_source::MaskSource;
use super::observer::{Message, Observer, Phase};
use super::prepare::{Prepared, began_with_another_cloud, check_same_groups, prepare};
use instgs_io::json::read_json;
use instgs_io::ply::ply_bytes;
use instgs_io::{
    Dataset, IoError, RunFolder, Split, atomic_write, checkpoint, copy_file, load_scene, read_bytes, write_ply,
    write_scene_file,
};
use instgs_train::config::Method;
use instgs_train::facts::{Bytes, Counts, Metrics, StageTime, TrainFacts};
use instgs_train::given::{GivenCloud, given_cloud};
use instgs_train::interrupt::Interrupt;
use instgs_train::{TrainMessage, Trained, evaluate_test_views, leave_out_masked, train};
use instgs_train::{check_finished, read_dataset};
use instgs_vk::gpu::Gpu;
use instgs_vk::render::Renderer;
use instgs_vk::scene::InstancedScene;

/// Prefixes of the keys that affect only the joint phase, or nothing that is computed.
const OF_JOINT_PHASE: [&str; 17] = [
    "offsets.sh_every",
    "joint.steps",
    "joint.final_factor",
    "joint.decay_start",
    "joint.decay_steps",
    "joint.prune_opacity",
    "joint.grow_fraction",
    "joint.max_expanded",
    "joint.refine_poses",
    "joint.instances_every",
    "template_rates.",
    "background_rates.",
    "offset_rates.",
    "pose_rates.",
    "eval_every",
    "checkpoint_every",
    "device_memory_mb",
];

/// Prefixes of the keys that a plain cloud does not depend on. That `steps` are the same is found otherwise: more of them go on.
const NOT_OF_PLAIN_CLOUD: [&str; 20] = [
    "steps",
    "method",
    "offsets.",
    "joint.",
    "template_rates.",
    "background_rates.",
    "offset_rates.",
    "pose_rates.",
    // Photos that are missing are found by comparing the data set.
    "skip_missing",
    "groups",
    "masks",
    "boxes",
    "prompt",
    "models",
    "detect.",
    "segment.",
    "template.",
    "eval_every",
    "checkpoint_every",
    "device_memory_mb",
];

/// Makes a trained scene from photos, with masks or with a source of masks.
///
/// ```no_run
/// use instgs_vk::gpu::{Gpu, GpuOptions};
/// use instgs_objects::pipeline::config::ConfigBuilder;
/// use instgs_objects::pipeline::{Message, Pipeline, PipelineJob};
/// use instgs_train::interrupt::Interrupt;
///
/// let config = ConfigBuilder::new().file("instgs_quick")?.finish()?;
/// let job = PipelineJob { data: "cars".into(), out: "runs/cars".into(), config, resume: false, accept_changed_data: false };
/// let gpu = Gpu::open(&GpuOptions::default())?;
/// let pipeline = Pipeline { gpu: &gpu, interrupt: &Interrupt::new() };
/// let finished = pipeline.run(&job, &mut |message: Message<'_>| {
///     eprintln!("{message:?}");
///     Ok(())
/// })?;
/// println!("{} instances", finished.scene.instances.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy)]
pub struct Pipeline<'a> {
    /// Device to render and train on.
    pub gpu: &'a Arc<Gpu>,
    /// Request to stop, checked between training steps.
    pub interrupt: &'a Interrupt,
}

/// Result of a finished run, besides its files.
pub struct Finished {
    /// The trained scene, of the last phase.
    pub scene: InstancedScene,
    /// Facts of its training; with templates and instances, of the joint phase.
    pub facts: TrainFacts,
    /// With templates and instances: results of the phases before the joint phase.
    pub objects: Option<ObjectPhases>,
}

/// Results of the phases before the joint phase.
pub struct ObjectPhases {
    /// Facts of the plain cloud's training, in this run or an earlier one; of a given cloud, as far as known.
    pub plain_cloud: TrainFacts,
    /// Results of the stages from masks to templates.
    pub prepared: Prepared,
}

impl Pipeline<'_> {
    /// Runs all phases that are not done yet, reports to `observer`, and leaves all results in the run folder.
    ///
    /// # Errors
    /// Faulty input, a device that fails, or an interrupted run.
    pub fn run(&self, job: &PipelineJob, observer: &mut dyn Observer) -> Result<Finished, PipelineError> {
        job.check_folders()?;
        check_same_method(job)?;
        match job.config.train.method {
            Method::Gaussians => {
                let trained = self.train(job, &job.out, Phase::PlainCloud, observer)?;
                Ok(Finished { scene: trained.scene, facts: trained.facts, objects: None })
            }
            Method::Instanced => self.run_with_objects(job, observer),
        }
    }

    fn run_with_objects(&self, job: &PipelineJob, observer: &mut dyn Observer) -> Result<Finished, PipelineError> {
        check_not_by_stages(job)?;
        check_same_stages(job)?;
        check_same_cloud(job)?;
        // Existing masks are checked before hours of training, and before the run folder is created.
        let are_there = matches!(MaskSource::of(job)?, MaskSource::Folder(_) | MaskSource::Boxes(_));
        let warned = if are_there { Some(checked(job, observer)?) } else { None };
        job.folder().create()?;
        let before = Before::of(job)?;
        // The joint phase writes it too, but a run that is stopped before must find it when it resumes.
        let text = job.config.to_toml()?;
        atomic_write(&job.folder().config(), |out| out.write_all(text.as_bytes()))?;
        let finished = self.run_phases(job, warned, observer);
        if finished.as_ref().is_err_and(|error| !matches!(error, PipelineError::Interrupted { .. })) {
            before.restore(job);
        }
        finished
    }

    /// Runs all phases in a folder that has its configuration. `warned` are the warnings about masks that the user has had; `None` if
    /// the masks are yet to be made and checked.
    fn run_phases(
        &self,
        job: &PipelineJob,
        warned: Option<Vec<String>>,
        observer: &mut dyn Observer,
    ) -> Result<Finished, PipelineError> {
        let naming = masks_from_prompt(job, observer)?;
        let warned = warned.map_or_else(|| checked(job, observer), Ok)?;
        let plain_cloud = match &job.config.train.init_scene {
            Some(scene) => self.take_cloud(job, scene, observer)?,
            None => self.train_cloud(job, observer)?,
        };
        observer.notify(Message::PhaseStarted(Phase::Objects))?;
        let mut prepared = prepare(self.gpu, job, observer)?;
        prepared.stages.splice(0..0, naming);
        for text in prepared.warnings().iter().filter(|text| !warned.contains(text)) {
            observer.notify(Message::Warning(text))?;
        }
        observer.notify(Message::Prepared(&prepared))?;
        observer.notify(Message::PhaseStarted(Phase::Joint))?;
        let trained = self.train(job, &job.out, Phase::Joint, observer)?;
        let objects = Some(ObjectPhases { plain_cloud, prepared });
        Ok(Finished { scene: trained.scene, facts: trained.facts, objects })
    }

    /// The joint phase alone: trains a scene of templates and instances into the job's folder. A job that resumes goes on if the phase
    /// has begun.
    ///
    /// # Errors
    /// Faulty input, a device that fails, an interrupted run, or a phase that began with another scene.
    pub fn joint(
        &self,
        job: &PipelineJob,
        scene: &InstancedScene,
        observer: &mut dyn Observer,
    ) -> Result<Trained, PipelineError> {
        job.check_folders()?;
        job.folder().create()?;
        let first = job.folder().initial_scene();
        if !job.resume || !joint_has_begun(&job.folder()) {
            write_scene_file(&first, scene)?;
        } else if !load_scene(&first)?.scene.shows_the_same(scene) {
            let error = IoError::new(&job.out, "its joint phase began with another scene");
            return Err(error.advise("give that one (initial.instgs), or train into another folder").into());
        }
        self.train(job, &job.out, Phase::Joint, observer)
    }

    /// Trains a phase of the run in the folder `run`.
    fn train(
        &self,
        job: &PipelineJob,
        run: &Path,
        phase: Phase,
        observer: &mut dyn Observer,
    ) -> Result<Trained, PipelineError> {
        let mut tell = |message: TrainMessage<'_>| observer.notify(Message::Training { phase, message });
        let trained = train(self.gpu, &job.training()?, self.interrupt, &mut tell)?;
        if trained.interrupted {
            let (data, out) = (job.data.clone(), run.into());
            return Err(PipelineError::Interrupted { steps: trained.facts.steps, data, out });
        }
        let (folder, config, facts) = (&job.folder(), &job.config, &trained.facts);
        observer.notify(Message::Trained { phase, folder, config, facts })?;
        Ok(trained)
    }

    /// Trains the plain cloud in a folder of its own, unless that is done.
    fn train_cloud(&self, job: &PipelineJob, observer: &mut dyn Observer) -> Result<TrainFacts, PipelineError> {
        let phase = job.cloud_phase();
        let run = phase.folder();
        let done = if job.resume { finished_training(&run)? } else { None };
        let facts = match done {
            Some(facts) if facts.steps == phase.config.train.steps => {
                // With a checkpoint of the joint phase the data set is compared with that.
                if checkpoint::latest(&job.folder().checkpoints())?.found.is_none() {
                    let warning = check_finished(&phase.training()?)?;
                    warning.iter().try_for_each(|text| observer.notify(Message::Warning(text)))?;
                }
                observer.notify(Message::Reused { folder: &run, config: &phase.config, facts: &facts })?;
                facts
            }
            _ => {
                observer.notify(Message::PhaseStarted(Phase::PlainCloud))?;
                self.train(&phase, &job.out, Phase::PlainCloud, observer)?.facts
            }
        };
        copy_file(&run.point_cloud(), &job.folder().point_cloud())?;
        Ok(facts)
    }

    /// Copies a given trained cloud into the run folder, and measures its quality.
    fn take_cloud(
        &self,
        job: &PipelineJob,
        scene: &Path,
        observer: &mut dyn Observer,
    ) -> Result<TrainFacts, PipelineError> {
        let started = Instant::now();
        let config = &job.config.train;
        let own = job.folder().point_cloud();
        // A joint phase goes on with the cloud that it began with, which the given file need not outlive.
        let has_begun = job.resume && joint_has_begun(&job.folder()) && own.is_file();
        let is_gone = has_begun && !scene.exists();
        let GivenCloud { cloud, file_bytes, warnings } = given_cloud(if is_gone { &own } else { scene }, config)?;
        if has_begun && !is_gone && read_bytes(&own)? != ply_bytes(&cloud, config.pixel_filter()) {
            return Err(began_with_another_cloud(&job.out).into());
        }
        warnings.iter().try_for_each(|text| observer.notify(Message::Warning(text)))?;
        let (pixel_filter, near_plane) = (config.pixel_filter(), config.near_plane());
        let scene = InstancedScene { pixel_filter, near_plane, ..InstancedScene::from_cloud(cloud) };
        // First, as a photo may be damaged, and then nothing has begun.
        let eval = self.evaluated(job, &scene)?;
        if !has_begun {
            write_ply(&own, &scene.background, config.pixel_filter())?;
        }
        let facts = TrainFacts {
            method: Method::Gaussians.name().into(),
            eval,
            stages: vec![StageTime::since("load", started)],
            gaussians: Counts::of(&scene),
            bytes: Bytes { file: file_bytes, host: scene.tensor_bytes(), ..Bytes::default() },
            device: self.gpu.caps().name.clone(),
            seed: config.seed,
            ..TrainFacts::default()
        };
        Ok(facts)
    }

    /// Means over the test views; `None` if there are none.
    fn evaluated(&self, job: &PipelineJob, scene: &InstancedScene) -> Result<Option<Metrics>, PipelineError> {
        let mut test: Vec<_> =
            Dataset::split(&read_dataset(&job.data, &job.config.train)?, Split::Test).cloned().collect();
        let config = &job.config.train;
        let width = (config.width > 0).then_some(config.width);
        // The joint phase leaves the same views out and warns about them.
        leave_out_masked(&mut test, width, &mut || Ok(()))?;
        if test.is_empty() {
            return Ok(None);
        }
        let mut renderer = Renderer::new(self.gpu)?;
        let device_scene = renderer.upload(scene)?;
        let report = evaluate_test_views(&mut renderer, &device_scene, &test, config, &mut |_| Ok(()))?;
        Ok(Some(report.mean))
    }
}

/// True if the joint phase of a run with templates and instances has begun: it has a checkpoint.
pub fn joint_has_begun(run: &RunFolder) -> bool {
    checkpoint::is_any_in(&run.checkpoints())
}

/// The facts of a finished training, if there is one; for versions that wrote none, from its report.
fn finished_training(run: &RunFolder) -> Result<Option<TrainFacts>, IoError> {
    let path: Option<PathBuf> = [run.facts(), run.report()].into_iter().find(|path| path.is_file());
    path.map(|path| read_json(&path)).transpose()
}

/// Checks the masks before the run begins; sends the warnings to `observer` and returns them.
fn checked(job: &PipelineJob, observer: &mut dyn Observer) -> Result<Vec<String>, PipelineError> {
    let warnings = check_masks(job)?;
    warnings.iter().try_for_each(|text| observer.notify(Message::Warning(text)))?;
    Ok(warnings)
}

/// A run that resumes keeps a plain cloud of so many steps, so what that was trained with must be unchanged. Once objects are found,
/// [`check_same_stages`] sees to that.
fn check_same_cloud(job: &PipelineJob) -> Result<(), PipelineError> {
    let phase = job.cloud_phase();
    let (run, steps) = (phase.folder(), phase.config.train.steps);
    let is_given = job.config.train.init_scene.is_some();
    let is_kept = job.resume && !is_given && finished_training(&run)?.is_some_and(|facts| facts.steps == steps);
    if !is_kept || is_segmented(&job.folder()) || !run.config().is_file() {
        return Ok(());
    }
    let earlier: RunConfig = ConfigBuilder::new().run_file(&run.config())?.finish()?;
    // Keys that an older version did not write are not what was changed.
    let text = String::from_utf8(read_bytes(&run.config())?).unwrap_or_default();
    let written: toml::Table = text.parse().unwrap_or_default();
    let is_written = |key: &str| match key.split_once('.') {
        Some((section, name)) => written.get(section).is_some_and(|section| section.get(name).is_some()),
        None => written.contains_key(key),
    };
    let matters = |key: &str| is_written(key) && !NOT_OF_PLAIN_CLOUD.iter().any(|free| key.starts_with(free));
    let changed = earlier.differences(&phase.config)?.into_iter().find(|(key, ..)| matters(key));
    let Some((key, was, now)) = changed else { return Ok(()) };
    let what = format!("its plain cloud was trained with {key} = {was}, and the run cannot continue with {now}");
    Err(IoError::new(&job.out, what).advise("leave that value, or train into another folder").into())
}

/// Refuses to go on with a run by another method: its results would be replaced, and its checkpoints do not fit.
///
/// # Errors
/// The run has another method; its configuration cannot be read.
pub fn check_same_method(job: &PipelineJob) -> Result<(), PipelineError> {
    let path = job.folder().config();
    if !job.resume || !path.is_file() {
        return Ok(());
    }
    let earlier: RunConfig = ConfigBuilder::new().run_file(&path)?.finish()?;
    let (was, now) = (earlier.train.method, job.config.train.method);
    if was == now {
        return Ok(());
    }
    let what = format!("is a run with method = {}, and cannot continue with {}", was.name(), now.name());
    let advice = format!("continue with --method {}, or train into another folder", was.name());
    Err(IoError::new(&job.out, what).advise(advice).into())
}

/// Refuses a folder whose joint phase was begun stage by stage: a whole run would begin with a plain cloud of its own, and
/// replace what that phase goes on from.
fn check_not_by_stages(job: &PipelineJob) -> Result<(), IoError> {
    let folder = job.folder();
    if job.resume && joint_has_begun(&folder) && folder.initial_scene().is_file() && !folder.prepared().is_file() {
        let error = IoError::new(&job.out, "its joint phase was begun stage by stage");
        return Err(error.advise("go on with Python's Pipeline(..., resume=True).joint, or train into another folder"));
    }
    Ok(())
}

/// A run that resumes keeps the objects and templates that it found, so their inputs must be unchanged.
///
/// # Errors
/// The first key whose value differs and matters to the objects; a configuration that cannot be read.
pub fn check_same_stages(job: &PipelineJob) -> Result<(), PipelineError> {
    let (folder, path) = (job.folder(), job.folder().config());
    let is_prepared = folder.initial_scene().is_file() && folder.prepared().is_file();
    if !job.resume || !path.is_file() || !(is_segmented(&folder) || is_prepared) {
        return Ok(());
    }
    let earlier: RunConfig = ConfigBuilder::new().run_file(&path)?.finish()?;
    // Whether poses are refined also decides whether given ones are before templates are made.
    let of_templates = earlier.pipeline.groups.as_ref().map(|_| "joint.refine_poses");
    let is_free = |key: &str| OF_JOINT_PHASE.iter().any(|free| key.starts_with(free)) && of_templates != Some(key);
    let changed = earlier.differences(&job.config)?.into_iter().find(|(key, ..)| !is_free(key));
    let Some((key, was, now)) = changed else {
        check_same_origin(job)?;
        return Ok(check_same_groups(job)?);
    };
    let what = format!("its objects were found with {key} = {was}, and it cannot continue with {now}");
    Err(IoError::new(&job.out, what).advise("leave that value, or train into another folder").into())
}
