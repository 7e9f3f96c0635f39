//! One phase of training: its run folder, log, progress and report.

use std::path::Path;
use std::sync::Arc;

use crate::cli::args::create_folder;
use crate::cli::device;
use crate::cli::error::CliError;
use crate::cli::printer::{Printer, Progress};
use crate::cli::table::grouped;
use crate::eval::Evaluated;
use crate::gpu::Gpu;
use crate::io::picture_png::write_png;
use crate::io::{IoError, RunFolder};
use crate::report::{self, ReportData, Rgb8, RunReport, ViewPicture};
use crate::scene::{InstancedScene, RepeatedBytes};
use crate::train::config::Method;
use crate::train::event_log::{EventLog, read_events};
use crate::train::events::{Event, EventSink, Tee};
use crate::train::facts::{Bytes, Counts, Quality, StageTime, ViewMetrics};
use crate::train::interrupt::Interrupt;
use crate::train::{TrainJob, Trained, train};

/// Test views whose pictures the page shows.
const PICTURES: usize = 8;

/// What all phases of a run share.
pub(in crate::cli) struct Session<'a> {
    pub(in crate::cli) gpu: &'a Arc<Gpu>,
    pub(in crate::cli) interrupt: &'a Interrupt,
    pub(in crate::cli) printer: &'a Printer,
}

/// Trains a phase of the run in folder `run` and writes its report and page; `complete` adds what the phase does not know.
pub(super) fn run_phase(
    session: &Session<'_>,
    run: &Path,
    job: &TrainJob,
    complete: impl FnOnce(&mut ReportData),
) -> Result<RunReport, CliError> {
    let Session { gpu, interrupt, printer } = *session;
    create_folder(&job.out)?;
    let mut log = open_log(job, printer)?;
    let mut progress = TrainProgress { printer, bar: None, steps: 0 };
    let mut pictures = Vec::new();
    let mut sink = Tee(vec![&mut log, &mut progress]);
    let mut keep = |view: Evaluated<'_>| pictures.push(picture_of(&view));
    let trained = train(gpu, job, &mut sink, interrupt, &mut |text| printer.warning(text), &mut keep);
    progress.bar = None;
    let trained = trained?;
    if trained.dropped_non_finite > 0 {
        printer.warning(format_args!("dropped {} Gaussians with a non-finite parameter", trained.dropped_non_finite));
    }
    device::check_validation(gpu)?;
    if trained.interrupted {
        return Err(interrupted(&job.data, run, trained.done));
    }
    log.flush()?;
    write_renders(&job.folder(), &pictures)?;
    let events = read_events(&job.folder().events())?;
    let report = run_report(job, &gpu.caps().name, &trained, &events)?;
    let shown = report::choose(&report.views, PICTURES).into_iter().filter_map(|i| pictures.get(i).cloned()).collect();
    let mut data = ReportData { report, events, pictures: shown, ..ReportData::default() };
    complete(&mut data);
    report::write(&job.folder(), &data)?;
    Ok(data.report)
}

fn interrupted(data: &Path, run: &Path, done: u64) -> CliError {
    let (data, out) = (data.display(), run.display());
    CliError::Other(format!("stopped after {done} steps; continue with --data {data} --out {out} --resume"))
}

fn open_log(job: &TrainJob, printer: &Printer) -> Result<EventLog, CliError> {
    let path = job.folder().events();
    if !job.resume {
        return Ok(EventLog::create(&path)?);
    }
    let newest = crate::io::checkpoint::latest(&job.folder().checkpoints())?;
    let step = newest.found.map_or(0, |(_, found)| found.step);
    let (log, dropped) = EventLog::resume(&path, step)?;
    if dropped.later > 0 {
        printer.line(format_args!("going on from step {step}; what came after it is done again"));
    }
    Ok(log)
}

/// Progress for people: a bar with loss, PSNR, Gaussians and speed, and lines for what happens between steps.
struct TrainProgress<'a> {
    printer: &'a Printer,
    bar: Option<Progress>,
    steps: u64,
}

impl EventSink for TrainProgress<'_> {
    fn event(&mut self, event: &Event) -> Result<(), IoError> {
        match event {
            Event::Started { step, steps, gaussians, views, test_views, device, .. } => {
                self.steps = *steps;
                let (gaussians, printer) = (grouped(*gaussians), self.printer);
                printer.line(format_args!(
                    "{device}: {gaussians} Gaussians, {views} training and {test_views} test views"
                ));
                let mut bar = printer.progress("train", self.steps);
                bar.advance_to(*step, "");
                self.bar = Some(bar);
            }
            Event::Step { step, loss, psnr, gaussians, steps_per_second, .. } => {
                let text = format!(
                    "loss {loss:.4}, PSNR {psnr:.2}, {} Gaussians, {steps_per_second:.2} steps/s",
                    grouped(*gaussians)
                );
                if let Some(bar) = &mut self.bar {
                    bar.advance_to(*step, text);
                }
            }
            Event::Evaluated { step, psnr, ssim, .. } => {
                self.printer.line(format_args!("step {step}: test PSNR {psnr:.2} dB, SSIM {ssim:.3}"));
            }
            Event::DeviceFull { step, gaussians } => {
                let gaussians = grouped(*gaussians);
                self.printer.line(format_args!(
                    "step {step}: {gaussians} Gaussians, as many as a binding of this device has room for: no more are added \
                     (max_gaussians allows more)"
                ));
            }
            _ => {}
        }
        Ok(())
    }
}

fn picture_of(view: &Evaluated<'_>) -> ViewPicture {
    let rgb8 = |pixels: &[[f32; 3]]| Rgb8 {
        width: view.pair.width(),
        height: view.pair.height(),
        pixels: pixels.iter().flatten().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect(),
    };
    let (psnr, ssim, lpips) = (view.metrics.psnr, view.metrics.ssim, view.metrics.lpips);
    ViewPicture {
        name: view.name.into(),
        metrics: Quality { psnr, ssim, lpips },
        ground_truth: rgb8(view.pair.target()),
        render: rgb8(view.pair.render()),
    }
}

fn write_renders(run: &RunFolder, pictures: &[ViewPicture]) -> Result<(), CliError> {
    if pictures.is_empty() {
        return Ok(());
    }
    let folder = run.renders();
    create_folder(&folder)?;
    for picture in pictures {
        let Rgb8 { width, height, pixels } = &picture.render;
        write_png(&folder.join(format!("{}.png", picture.name)), pixels, (*width, *height))?;
    }
    Ok(())
}

/// Gaussians of a scene by what they are.
pub(in crate::cli) fn counts(scene: &InstancedScene) -> Counts {
    Counts {
        template: scene.templates.len() as u64,
        offsets: scene.offsets.len() as u64,
        background: scene.background.len() as u64,
        expanded: scene.expanded_len(),
    }
}

fn run_report(job: &TrainJob, device: &str, trained: &Trained, events: &[Event]) -> Result<RunReport, CliError> {
    let file = match job.config.method {
        Method::Gaussians => job.folder().point_cloud(),
        Method::Instanced => job.folder().scene(),
    };
    let bytes = std::fs::metadata(&file).map_err(|e| IoError::new(&file, format!("cannot be read: {e}")))?.len();
    let times = &trained.times;
    let stages = trained.stages.iter().map(|stage| match stage.name.as_str() {
        // Of a run that was resumed, this process trained the last part only.
        "train" => StageTime { seconds: report::training_seconds(events), ..stage.clone() },
        _ => stage.clone(),
    });
    let stages: Vec<StageTime> = stages.collect();
    let quality = |m: &crate::eval::Metrics| Quality { psnr: m.psnr, ssim: m.ssim, lpips: m.lpips };
    let views = trained.eval.as_ref().map(|e| e.views.as_slice()).unwrap_or_default();
    let scene_bytes = trained.memory.iter().find(|m| m.name == "parameters").map_or(0, |m| m.bytes);
    Ok(RunReport {
        method: job.config.method.name().into(),
        steps: trained.done,
        seconds: stages.iter().map(|s| s.seconds).sum(),
        steps_per_second: trained.steps_per_second,
        stages,
        passes_ms: times.passes_ms.iter().map(|(k, ms)| ((*k).into(), ms / times.steps.max(1) as f64)).collect(),
        eval: trained.eval.as_ref().map(|e| quality(&e.mean)),
        gaussians: counts(&trained.scene),
        bytes: Bytes {
            file: bytes,
            host: trained.scene.tensor_bytes(),
            device_scene: scene_bytes,
            device_peak: trained.device_peak,
        },
        device: device.into(),
        seed: job.config.seed,
        version: env!("CARGO_PKG_VERSION").into(),
        host_fraction: times.host.as_secs_f64() / times.total.as_secs_f64().max(1e-9),
        memory_explained: trained.memory.clone(),
        views: views
            .iter()
            .map(|v| ViewMetrics {
                name: v.name.clone(),
                quality: Quality { psnr: v.psnr, ssim: v.ssim, lpips: v.lpips },
            })
            .collect(),
        repeated: (!trained.scene.instances.is_empty()).then(|| RepeatedBytes::of(&trained.scene)),
        dataset: trained.dataset.clone(),
        config: job.config.clone(),
        ..RunReport::default()
    })
}
