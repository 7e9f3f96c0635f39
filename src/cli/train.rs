//! `instgs-vk train`: from photos to a scene.

use std::path::{Path, PathBuf};

use clap::Args;

use super::args::create_folder;
use super::device::{self, DeviceArgs};
use super::error::CliError;
use super::printer::{Printer, Progress};
use super::table::{Table, grouped};
use crate::eval::Evaluated;
use crate::io::IoError;
use crate::train::config::{ConfigBuilder, TrainConfig};
use crate::train::event_log::{EventLog, read_events};
use crate::train::events::{Event, EventSink, Tee};
use crate::train::interrupt::Interrupt;
use crate::train::report::{self, Bytes, Counts, Quality, ReportData, Rgb8, RunReport, ViewMetrics, ViewPicture};
use crate::train::{TrainJob, Trained, train};

/// Test views whose pictures the page shows.
const PICTURES: usize = 8;

/// Trains a scene of Gaussians from photos with known cameras.
///
/// DATA holds transforms.json (or transforms_train.json and transforms_test.json), or a COLMAP model in sparse/0 with
/// images/. RUN gets config.toml, checkpoints/, events.jsonl, point_cloud.ply, scene.instgs, report.json, report.html and
/// renders/ of the test views. Ctrl-C writes a checkpoint; --resume goes on from the newest one.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk train --data fox --out runs/fox --config quick --width 270\n  \
    instgs-vk train --data garden --out runs/garden --set strategy=mcmc --max-gaussians 500000\n  \
    instgs-vk train --data garden --out runs/garden --resume")]
pub(super) struct TrainArgs {
    /// Dataset folder
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Run folder; made if it is not there
    #[arg(long, value_name = "RUN")]
    out: PathBuf,
    /// What is trained: 3dgs, a plain cloud
    #[arg(long, value_name = "METHOD")]
    method: Option<String>,
    /// Start from this scene instead of the dataset's points
    #[arg(long, value_name = "SCENE")]
    init: Option<PathBuf>,
    /// A preset (default, quick, paper, mcmc) or a TOML file
    #[arg(long, value_name = "F")]
    config: Option<String>,
    /// One value of the configuration, for instance --set rates.means=1e-4; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Optimisation steps in all
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Downscale training pictures to this width
    #[arg(long, value_name = "W")]
    width: Option<u32>,
    /// Fixes everything that is random
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Never more Gaussians than this
    #[arg(long, value_name = "N")]
    max_gaussians: Option<u32>,
    /// Evaluate the test views every N steps, besides at the end
    #[arg(long, value_name = "N")]
    eval_every: Option<u64>,
    /// Go on from the newest checkpoint of RUN; configuration and seed are RUN's own, under the flags given now
    #[arg(long)]
    resume: bool,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

impl TrainArgs {
    fn resolved(&self) -> Result<TrainConfig, CliError> {
        let own = self.out.join("config.toml");
        let mut builder = ConfigBuilder::new();
        if self.resume && own.is_file() {
            builder = builder.file(&own.display().to_string())?;
        }
        if let Some(file) = &self.config {
            builder = builder.file(file)?;
        }
        for assignment in &self.set {
            builder = builder.set(assignment)?;
        }
        if let Some(method) = &self.method {
            builder = builder.flag("--method", "method", method.as_str())?;
        }
        if let Some(path) = &self.init {
            builder = builder.flag("--init", "init_scene", absolute(path)?)?;
        }
        let numbers = [
            ("--steps", "steps", self.steps),
            ("--width", "width", self.width.map(u64::from)),
            ("--seed", "seed", self.seed),
            ("--max-gaussians", "max_gaussians", self.max_gaussians.map(u64::from)),
            ("--eval-every", "eval_every", self.eval_every),
        ];
        for (flag, key, value) in numbers {
            if let Some(value) = value {
                let value =
                    i64::try_from(value).map_err(|_| CliError::Other(format!("{flag}: {value} is too large")))?;
                builder = builder.flag(flag, key, value)?;
            }
        }
        Ok(builder.finish()?)
    }

    fn check_folder(&self) -> Result<(), CliError> {
        let taken = ["config.toml", "checkpoints", "report.json", "point_cloud.ply"];
        let Some(found) = taken.iter().find(|name| self.out.join(name).exists()) else { return Ok(()) };
        if self.resume {
            return Ok(());
        }
        let error = IoError::new(&self.out, format!("holds a run already ({found})"));
        Err(error.advise("continue it with --resume, or choose another folder").into())
    }
}

/// A path as the configuration keeps it: valid in whatever folder the run is resumed.
fn absolute(path: &Path) -> Result<String, CliError> {
    let fail = |what: String| CliError::Other(format!("--init: {what}"));
    let absolute = std::path::absolute(path).map_err(|e| fail(format!("{}: {e}", path.display())))?;
    absolute.into_os_string().into_string().map_err(|p| fail(format!("{} is not UTF-8 text", p.display())))
}

pub(super) fn run(args: &TrainArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let config = args.resolved()?;
    args.check_folder()?;
    // Before anything is made: a folder without cameras should not leave an empty run.
    crate::io::read_views(&args.data)?;
    let interrupt = Interrupt::on_ctrl_c().map_err(|e| CliError::Other(e.to_string()))?;
    let gpu = device::open(device_args.choice())?;
    let job = TrainJob { data: args.data.clone(), out: args.out.clone(), config, resume: args.resume };
    create_folder(&args.out)?;
    let mut log = open_log(args, printer)?;
    let mut progress = TrainProgress { printer, bar: None, steps: job.config.steps };
    let mut pictures = Vec::new();
    let mut sink = Tee(vec![&mut log, &mut progress]);
    let mut keep = |view: Evaluated<'_>| pictures.push(picture_of(&view));
    let trained = train(&gpu, &job, &mut sink, &interrupt, &mut |text| printer.warning(text), &mut keep);
    progress.bar = None;
    let trained = trained?;
    if trained.dropped_non_finite > 0 {
        printer.warning(format_args!("dropped {} Gaussians with a non-finite parameter", trained.dropped_non_finite));
    }
    device::check_validation(&gpu)?;
    if trained.interrupted {
        let (done, out) = (trained.done, args.out.display());
        return Err(CliError::Other(format!(
            "stopped after {done} steps; continue with --data {} --out {out} --resume",
            args.data.display()
        )));
    }
    log.flush()?;
    let report = run_report(&job, &gpu.caps().name, &trained, &args.out)?;
    write_renders(&args.out, &pictures)?;
    let events = read_events(&args.out.join("events.jsonl"))?;
    let shown = report::choose(&report.views, PICTURES).into_iter().filter_map(|i| pictures.get(i).cloned()).collect();
    let data = ReportData { report, events, pictures: shown };
    report::write(&args.out, &data)?;
    if args.json {
        return printer.json(&data.report);
    }
    print_report(&data.report, &args.out, printer);
    Ok(())
}

fn open_log(args: &TrainArgs, printer: &Printer) -> Result<EventLog, CliError> {
    let path = args.out.join("events.jsonl");
    if !args.resume {
        return Ok(EventLog::create(&path)?);
    }
    let newest = crate::io::checkpoint::latest(&args.out.join("checkpoints"))?;
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
            Event::Started { step, gaussians, views, test_views, device, .. } => {
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

fn write_renders(out: &Path, pictures: &[ViewPicture]) -> Result<(), CliError> {
    if pictures.is_empty() {
        return Ok(());
    }
    let folder = out.join("renders");
    create_folder(&folder)?;
    for picture in pictures {
        let Rgb8 { width, height, pixels } = &picture.render;
        super::picture_files::write_png(&folder.join(format!("{}.png", picture.name)), pixels, (*width, *height))?;
    }
    Ok(())
}

fn run_report(job: &TrainJob, device: &str, trained: &Trained, out: &Path) -> Result<RunReport, CliError> {
    let file = out.join("point_cloud.ply");
    let bytes = std::fs::metadata(&file).map_err(|e| IoError::new(&file, format!("cannot be read: {e}")))?.len();
    let times = &trained.times;
    let count = trained.scene.background.len() as u64;
    let quality = |m: &crate::eval::Metrics| Quality { psnr: m.psnr, ssim: m.ssim, lpips: m.lpips };
    let views = trained.eval.as_ref().map(|e| e.views.as_slice()).unwrap_or_default();
    let scene_bytes = trained.memory.iter().find(|m| m.name == "parameters").map_or(0, |m| m.bytes);
    Ok(RunReport {
        method: "3dgs".into(),
        steps: trained.done,
        seconds: trained.stages.iter().map(|s| s.seconds).sum(),
        steps_per_second: trained.steps_per_second,
        stages: trained.stages.clone(),
        passes_ms: times.passes_ms.iter().map(|(k, ms)| ((*k).into(), ms / times.steps.max(1) as f64)).collect(),
        eval: trained.eval.as_ref().map(|e| quality(&e.mean)),
        gaussians: Counts { background: count, expanded: count, ..Counts::default() },
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
        dataset: trained.dataset.clone(),
        config: job.config.clone(),
        ..RunReport::default()
    })
}

fn print_report(report: &RunReport, out: &Path, printer: &Printer) {
    let mut table = Table::default();
    let mut row = |name: &str, value: String| table.row([name.into(), value]);
    row("steps", format!("{} in {:.1} s, {:.2} a second", report.steps, report.seconds, report.steps_per_second));
    row("Gaussians", grouped(report.gaussians.background));
    if let Some(eval) = &report.eval {
        let lpips = eval.lpips.map(|v| format!(", LPIPS {v:.3}")).unwrap_or_default();
        row("test views", format!("PSNR {:.2} dB, SSIM {:.4}{lpips}", eval.psnr, eval.ssim));
    }
    row("file", format!("{} bytes", grouped(report.bytes.file)));
    row("device, most at a time", format!("{} bytes", grouped(report.bytes.device_peak)));
    printer.line(table);
    printer.line(format_args!("everything is in {}; report.html shows it", out.display()));
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    type Test = Result<(), Box<dyn std::error::Error>>;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: TrainArgs,
    }

    fn resolved(out: &Path, more: &[&str]) -> Result<TrainConfig, Box<dyn std::error::Error>> {
        let out = out.display().to_string();
        let line = [&["train", "--data", "d", "--out", &out], more].concat();
        Ok(Line::try_parse_from(line)?.args.resolved()?)
    }

    #[test]
    fn a_resumed_run_knows_the_scene_it_started_from() -> Test {
        let folder = tempfile::tempdir()?;
        let here = std::env::current_dir()?;
        let config = resolved(folder.path(), &["--init", "a/../b.ply", "--set", "init_scene=c.ply"])?;
        // The flag is above --set; links are left as they are.
        assert_eq!(Path::new(&config.init_scene), here.join("a/../b.ply"));
        std::fs::write(folder.path().join("config.toml"), config.to_toml()?)?;
        assert_eq!(resolved(folder.path(), &["--resume"])?.init_scene, config.init_scene);
        assert_eq!(resolved(folder.path(), &["--resume", "--init", "/x.ply"])?.init_scene, "/x.ply");
        assert_eq!(resolved(folder.path(), &[])?.init_scene, "");
        Ok(())
    }
}
