//! `instgs-vk segment`: finds the object of each Gaussian of a trained plain cloud.

use std::path::{Path, PathBuf};

use clap::Args;

use super::with_sets;
use crate::progress_lines::LabelLines;
use instgs_console::args::absolute;
use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_io::{IoError, RunFolder};
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_objects::pipeline::{PipelineJob, check_masks, label_gaussians, write_cloud};
use instgs_objects::segment::ConsensusReport;
use instgs_report::stage_pictures;
use instgs_train::config::Method;
use instgs_train::given::given_plain_cloud;

/// Finds the objects of a trained plain cloud in the masks of its training views.
///
/// Masks are those of train: a PNG of ids per photo, or files of other programs (docs/masks.md); ids need not be the same
/// from view to view.
/// DIR gets the scene as point_cloud.ply, cameras.json, consensus.json (the object that each mask shows),
/// labels.safetensors (the object of each Gaussian) and config.toml, which register and merge read, and review.html,
/// which shows every view with its masks and objects. train --method instgs does the same between its two phases.
#[derive(Args)]
#[command(after_help = "Example, all three stages:\n  \
    instgs-vk segment --scene runs/cars/point_cloud.ply --data cars --out cars_segments\n  \
    instgs-vk register --segments cars_segments --out cars_groups.json\n  \
    instgs-vk merge --segments cars_segments --groups cars_groups.json --out cars.instgs")]
pub(crate) struct SegmentArgs {
    /// Scene without instances: .ply, .spz, .sog, .splat, .glb or .instgs
    #[arg(long, value_name = "PLY")]
    scene: PathBuf,
    /// Dataset folder that the scene was trained on
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Masks, as for train [default: DATA/masks]
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    /// Folder for the results; created if necessary
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A preset or a TOML file, as for train; the keys width, near, antialias, dilation, background, sh_degree, seed and the
    /// sections segment, template, offsets and joint are used
    #[arg(long, value_name = "F")]
    config: Option<String>,
    /// One value of the configuration; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Width at which the views are rendered, that of the scene's training
    #[arg(long, value_name = "W")]
    width: Option<u32>,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(crate) json: bool,
}

/// The report printed with `--json`.
#[derive(serde::Serialize)]
struct Report<'a> {
    scene: &'a Path,
    out: &'a Path,
    gaussians: usize,
    background: usize,
    consensus: &'a ConsensusReport,
    warnings: Vec<String>,
    seconds: f64,
}

pub(crate) fn run(args: &SegmentArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    check_folder(&args.out)?;
    let job = PipelineJob {
        data: args.data.clone(),
        out: args.out.clone(),
        config: args.resolved()?,
        resume: false,
        accept_changed_data: false,
    };
    let mut warnings = check_masks(&job)?;
    let given = given_plain_cloud(&args.scene, &job.config.train)?;
    warnings.extend(given.warnings);
    warnings.iter().for_each(|text| printer.warning(text));
    let gpu = device::open(device_args.choice())?;
    let cloud = write_cloud(&job, &given.cloud)?;
    let mut lines = LabelLines::new(printer);
    let found = label_gaussians(&gpu, &job, &cloud, &mut lines);
    drop(lines);
    let found = found?;
    device::check_validation(&gpu)?;
    if let Some(text) = found.consensus.warning() {
        printer.warning(&text);
        warnings.push(text);
    }
    stage_pictures::review_segments(&job)?;
    let report = Report {
        scene: &args.scene,
        out: &args.out,
        gaussians: found.labels.len(),
        background: found.labels.iter().filter(|&&label| label == 0).count(),
        consensus: &found.consensus,
        warnings,
        seconds: found.stages.iter().map(|stage| stage.seconds).sum(),
    };
    if args.json {
        return printer.json(&report);
    }
    print(&report, printer);
    Ok(())
}

impl SegmentArgs {
    fn resolved(&self) -> Result<RunConfig, CliError> {
        let mut builder = ConfigBuilder::new();
        if let Some(file) = &self.config {
            builder = builder.file(file)?;
        }
        builder = with_sets(builder, &self.set)?.flag("--scene", "init_scene", absolute("--scene", &self.scene)?)?;
        if let Some(masks) = &self.masks {
            builder = builder.flag("--masks", "masks", absolute("--masks", masks)?)?;
        }
        if let Some(width) = self.width {
            builder = builder.flag("--width", "width", i64::from(width))?;
        }
        let mut config = builder.flag("segment", "method", Method::Instanced.name())?.finish()?;
        config.pipeline.groups = None;
        Ok(config)
    }
}

/// Refuses a folder whose files would be mixed with those of another scene.
fn check_folder(out: &Path) -> Result<(), CliError> {
    match RunFolder::new(out).trace_of_segments() {
        Some(found) => {
            let error = IoError::new(out, format!("holds segments or a run already ({found})"));
            Err(error.advise("choose another folder").into())
        }
        None => Ok(()),
    }
}

fn print(report: &Report<'_>, printer: &Printer) {
    let mut table = Table::default();
    table.row(["object", "category", "views", "masks", "Gaussians"].map(String::from));
    for object in &report.consensus.objects {
        table.row([
            object.id.to_string(),
            object.category.clone().unwrap_or_else(|| "-".into()),
            grouped(object.views as u64),
            grouped(object.masks as u64),
            grouped(object.gaussians as u64),
        ]);
    }
    printer.line(table);
    let [gaussians, background] = [report.gaussians, report.background].map(|count| grouped(count as u64));
    let out = report.out.display();
    printer.line(format_args!("masks and objects of every view: {}", RunFolder::new(report.out).review().display()));
    printer.line(format_args!(
        "{out}: {gaussians} Gaussians, {background} in no object; next: instgs-vk register --segments {out} --out groups.json"
    ));
}
