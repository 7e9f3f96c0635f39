//! `train --method instgs`: the plain cloud, what belongs to what, the merged scene, the joint phase.

use std::fs;
use std::path::Path;
use std::time::Instant;

use super::phase::{Session, counts, run_phase};
use crate::cli::args::create_folder;
use crate::cli::error::CliError;
use crate::cli::masks::{NamingLines, warn};
use crate::cli::printer::Printer;
use crate::cli::stages::{LabelLines, group_lines};
use crate::io::json::read_json;
use crate::io::{Dataset, IoError, Split, read_views, write_ply};
use crate::pipeline::label_gaussians::require_segments;
use crate::pipeline::{MaskSource, Prepared, check_masks, masks_from_prompt, prepare};
use crate::render::Renderer;
use crate::report::{JointMatch, ReportData, ReportError, RunReport, StagePictures, stage_pictures};
use crate::scene::InstancedScene;
use crate::train::config::{ConfigBuilder, TrainConfig};
use crate::train::event_log::read_events;
use crate::train::events::Event;
use crate::train::facts::{Bytes, Quality, StageTime};
use crate::train::given::{GivenCloud, given_cloud};
use crate::train::{TrainError, TrainJob, eval_options, leave_out_masked};

/// How the keys begin that only the joint phase goes by, or that say nothing of the outcome.
const OF_JOINT_PHASE: [&str; 12] = [
    "joint.steps",
    "joint.final_factor",
    "joint.decay_start",
    "joint.prune_opacity",
    "joint.refine_poses",
    "template_rates.",
    "background_rates.",
    "offset_rates.",
    "pose_rates.",
    "eval_every",
    "checkpoint_every",
    "device_memory_mb",
];

/// The plain cloud that the run starts from; its file is in the run folder.
struct PlainCloud {
    report: RunReport,
    /// Of its training; empty if it was given.
    events: Vec<Event>,
}

/// All stages; the report is that of the joint phase, with the plain cloud's in `vanilla`.
pub(super) fn run(session: &Session<'_>, job: &TrainJob) -> Result<RunReport, CliError> {
    check_same_stages(job)?;
    let source = MaskSource::of(job)?;
    // Masks that are there are looked at before hours of training, and before the folder is there.
    let given = matches!(source, MaskSource::Folder(_) | MaskSource::Boxes(_));
    let told = if given { checked(session, job)? } else { Vec::new() };
    create_folder(&job.out)?;
    // The joint phase writes it, too; but a run that is stopped before that must know itself when it goes on.
    let text = job.config.to_toml()?;
    crate::io::atomic_write(&job.folder().config(), |out| out.write_all(text.as_bytes()))?;
    let naming = found_by_name(session.printer, job)?;
    let told = if given { told } else { checked(session, job)? };
    let given = !job.config.init_scene.is_empty();
    let cloud = if given { taken_cloud(session, job)? } else { trained_cloud(session, job)? };
    let mut prepared = prepared(session, job, &told)?;
    prepared.stages.splice(0..0, naming);
    let pictures = Pictures::draw(session, job, &prepared);
    run_phase(session, &job.out, job, |data| {
        let pictures = pictures.with_trained_templates(session, job);
        complete(data, cloud, prepared, pictures);
    })
}

/// Makes the masks of a run with a prompt, unless they are there.
fn found_by_name(printer: &Printer, job: &TrainJob) -> Result<Option<StageTime>, CliError> {
    let mut lines = NamingLines::new(printer);
    let found = masks_from_prompt(job, &mut |name, view, total| lines.at(name, view, total));
    drop(lines);
    let Some(found) = found? else { return Ok(None) };
    warn(&found.report, printer);
    Ok(Some(found.stage))
}

/// What the user should know of the masks before the run begins; it is told.
fn checked(session: &Session<'_>, job: &TrainJob) -> Result<Vec<String>, CliError> {
    let told = check_masks(job)?;
    told.iter().for_each(|text| session.printer.warning(text));
    Ok(told)
}

/// A run that goes on keeps the objects and templates that it found: what these came from must be as it was.
fn check_same_stages(job: &TrainJob) -> Result<(), CliError> {
    let path = job.folder().config();
    if !job.resume || !path.is_file() || require_segments(&job.folder()).is_err() {
        return Ok(());
    }
    let earlier = ConfigBuilder::new().file(&path.display().to_string())?.finish()?;
    let is_free = |key: &str| OF_JOINT_PHASE.iter().any(|free| key.starts_with(free));
    let changed = earlier.differences(&job.config)?.into_iter().find(|(key, ..)| !is_free(key));
    let Some((key, was, now)) = changed else { return Ok(()) };
    let what = format!("its objects were found with {key} = {was}, and it cannot go on with {now}");
    Err(IoError::new(&job.out, what).advise("leave that value, or train into another folder").into())
}

/// What the stages did, to be looked at. A run is worth more than its pictures: if they cannot be made it goes on.
#[derive(Default)]
struct Pictures {
    drawn: Option<StagePictures>,
    seconds: f64,
}

impl Pictures {
    fn draw(session: &Session<'_>, job: &TrainJob, prepared: &Prepared) -> Self {
        let started = Instant::now();
        let drawn = stage_pictures::draw(session.gpu, job, prepared);
        let drawn = drawn.map_err(|error| warn_of_pictures(session, &error)).ok();
        if drawn.is_some() {
            let folder = job.folder().stage_pictures();
            session.printer.line(format_args!("pictures of masks, objects, poses and templates: {}", folder.display()));
        }
        match stage_pictures::review_segments(job) {
            Ok(()) => {
                let path = job.folder().review();
                session.printer.line(format_args!("masks and objects of every view: {}", path.display()));
            }
            Err(error) => session.printer.warning(format_args!("the sheet of masks is missing: {error}")),
        }
        Self { drawn, seconds: started.elapsed().as_secs_f64() }
    }

    fn with_trained_templates(mut self, session: &Session<'_>, job: &TrainJob) -> Self {
        let started = Instant::now();
        if let Some(drawn) = &mut self.drawn
            && let Err(error) = stage_pictures::add_trained_templates(session.gpu, job, drawn)
        {
            warn_of_pictures(session, &error);
        }
        self.seconds += started.elapsed().as_secs_f64();
        self
    }
}

fn warn_of_pictures(session: &Session<'_>, error: &ReportError) {
    session.printer.warning(format_args!("pictures of the stages are missing: {error}"));
}

/// Makes the joint phase's report that of the whole run.
fn complete(data: &mut ReportData, cloud: PlainCloud, prepared: Prepared, pictures: Pictures) {
    let report = &mut data.report;
    let of_phase = |phase: &str, stages: &[StageTime]| -> Vec<StageTime> {
        stages.iter().map(|s| StageTime { name: format!("{phase}: {}", s.name), ..s.clone() }).collect()
    };
    let joint = of_phase("joint", &report.stages);
    report.warnings = prepared.warnings();
    let drawing = vec![StageTime { name: "pictures".into(), seconds: pictures.seconds }];
    report.stages = [of_phase("3dgs", &cloud.report.stages), prepared.stages, drawing, joint].concat();
    report.seconds = report.stages.iter().map(|s| s.seconds).sum();
    report.groups = prepared.groups;
    report.registration = prepared.registration;
    report.joint_match = JointMatch::of(&cloud.events, &data.events, report.dataset.train_views);
    report.vanilla = Some(Box::new(cloud.report));
    data.vanilla_events = cloud.events;
    data.stages = pictures.drawn.unwrap_or_default();
}

/// Trains in `RUN/vanilla`, unless that is done.
fn trained_cloud(session: &Session<'_>, job: &TrainJob) -> Result<PlainCloud, CliError> {
    let run = job.folder().plain_cloud_run();
    let path = run.report();
    let config = job.config.cloud_phase();
    let done = if job.resume && path.is_file() { Some(read_json::<RunReport>(&path)?) } else { None };
    let report = match done {
        Some(report) if report.steps == config.steps => report,
        _ => {
            session.printer.line("1 of 3: a plain cloud of Gaussians");
            run_phase(session, &job.out, &TrainJob { out: run.path().into(), config, ..job.clone() }, |_| ())?
        }
    };
    let (from, to) = (run.point_cloud(), job.folder().point_cloud());
    let bytes = fs::read(&from).map_err(|e| IoError::new(&from, format!("cannot read: {e}")))?;
    crate::io::atomic_write(&to, |file| file.write_all(&bytes))?;
    // The log of a cloud that is reused may have been removed; only the page needs it.
    let log = run.events();
    let events = if log.is_file() { read_events(&log)? } else { Vec::new() };
    Ok(PlainCloud { report, events })
}

/// Takes over a trained cloud, and looks how good it is.
fn taken_cloud(session: &Session<'_>, job: &TrainJob) -> Result<PlainCloud, CliError> {
    let started = Instant::now();
    let GivenCloud { cloud, file_bytes, warnings } = given_cloud(Path::new(&job.config.init_scene), &job.config)?;
    warnings.iter().for_each(|text| session.printer.warning(text));
    write_ply(&job.folder().point_cloud(), &cloud, job.config.antialias)?;
    let scene = InstancedScene { antialias: job.config.antialias, ..InstancedScene::from_cloud(cloud) };
    let eval = evaluated(session, job, &scene)?;
    let seconds = started.elapsed().as_secs_f64();
    let report = RunReport {
        method: "3dgs".into(),
        seconds,
        stages: vec![StageTime { name: "load".into(), seconds }],
        eval,
        gaussians: counts(&scene),
        bytes: Bytes { file: file_bytes, host: scene.tensor_bytes(), ..Bytes::default() },
        device: session.gpu.caps().name.clone(),
        seed: job.config.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        config: TrainConfig { steps: 1, ..job.config.cloud_phase() },
        ..RunReport::default()
    };
    Ok(PlainCloud { report, events: Vec::new() })
}

/// Means over the test views; `None` if there are none.
fn evaluated(session: &Session<'_>, job: &TrainJob, scene: &InstancedScene) -> Result<Option<Quality>, CliError> {
    let mut test: Vec<_> = Dataset::split(&read_views(&job.data)?, Split::Test).cloned().collect();
    let width = (job.config.width > 0).then_some(job.config.width);
    // The joint phase, which leaves them out as well, tells of them.
    leave_out_masked(&mut test, width)?;
    if test.is_empty() {
        return Ok(None);
    }
    let mut renderer = Renderer::new(session.gpu).map_err(TrainError::from)?;
    let device_scene = renderer.upload(scene).map_err(TrainError::from)?;
    let options = eval_options(&job.config);
    let report =
        crate::eval::evaluate::<TrainError>(&mut renderer, &device_scene, &test, width, &options, None, |_| Ok(()))?;
    Ok(Some(Quality { psnr: report.mean.psnr, ssim: report.mean.ssim, lpips: report.mean.lpips }))
}

/// Labels and templates, unless that is done. Warnings that the user has read are not repeated.
fn prepared(session: &Session<'_>, job: &TrainJob, told: &[String]) -> Result<Prepared, CliError> {
    let printer = session.printer;
    printer.line("2 of 3: which Gaussian belongs to which object, and one template per group");
    let mut progress = LabelLines::new(printer);
    let result = prepare(session.gpu, job, &mut |at| progress.at(at));
    drop(progress);
    let result = result?;
    result.warnings().iter().filter(|text| !told.contains(text)).for_each(|text| printer.warning(text));
    group_lines(&result.groups, printer);
    printer.line("3 of 3: templates, offsets, background and poses together");
    Ok(result)
}
