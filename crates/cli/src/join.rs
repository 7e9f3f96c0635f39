//! `instgs-vk join`: makes one scene of trained blocks.

use std::path::{Path, PathBuf};

use clap::Args;

use super::training::{Session, refine_scene};
use instgs_blocks::join::read_runs;
use instgs_blocks::{JoinInput, JoinReport, Joined, join};
use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_io::{IoError, RunFolder, Split, copy_file, load_scene, read_views, save_scene};
use instgs_objects::pipeline::PipelineJob;
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_train::config::Method;
use instgs_train::interrupt::Interrupt;
use instgs_vk::scene::{Camera, InstancedScene};

/// Makes one scene of the trained blocks of a data set that split divided.
///
/// Of each block's background the part on its own ground is kept. Objects that several blocks have are kept once. Templates of
/// different blocks that registration finds alike become one, with all objects as its instances. --refine then trains the
/// joined scene for a few hundred steps on the whole data set, if the device holds it.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk join city_blocks/*/run --out city.instgs\n  \
    instgs-vk join city_blocks/*/run --out city.instgs --refine runs/city --refine-steps 500")]
pub(super) struct JoinArgs {
    /// Run folder or scene file of every block, each in the folder of its block
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,
    /// Scene file to write, .instgs
    #[arg(long, value_name = "X.instgs")]
    out: PathBuf,
    /// Dataset folder of the whole [default: the one that was split]
    #[arg(long, value_name = "DATA")]
    data: Option<PathBuf>,
    /// Train the joined scene on the whole data set in this run folder, and write the result; the same command again goes on
    /// after it was stopped
    #[arg(long, value_name = "RUN")]
    refine: Option<PathBuf>,
    /// Steps of that training
    #[arg(long, value_name = "N", default_value_t = 300, requires = "refine")]
    refine_steps: u32,
    /// Configuration of that training: a preset or a TOML file [default: the first block's run's]
    #[arg(long, value_name = "F", requires = "refine")]
    config: Option<String>,
    /// One value of that configuration; may be repeated
    #[arg(long, value_name = "KEY=VALUE", requires = "refine")]
    set: Vec<String>,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(serde::Serialize)]
struct Report {
    out: String,
    instances: usize,
    gaussians: usize,
    expanded: u64,
    #[serde(flatten)]
    joined: JoinReport,
}

pub(super) fn run(args: &JoinArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    if args.out.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("instgs")) {
        return Err(IoError::new(&args.out, "is not named .instgs")
            .advise("instances are kept in .instgs files")
            .into());
    }
    let runs = read_runs(&args.runs)?;
    let data = args.data.clone().unwrap_or_else(|| runs.plan.data.clone());
    let config = args.refine.as_ref().map(|_| args.refine_config(&runs.files[0])).transpose()?;
    let cameras = cameras(&data, args, printer)?;
    let gpu = device::open(device_args.choice())?;
    let input = JoinInput { plan: &runs.plan, scenes: &runs.scenes, cameras: &cameras, gpu: Some(&gpu) };
    let mut joined = join(&input).map_err(|error| CliError::msg(error.to_string()))?;
    joined.report.warnings.splice(0..0, runs.warnings);
    joined.report.warnings.iter().for_each(|text| printer.warning(text));
    if args.refine.is_some() && joined.scene.instances.is_empty() {
        let what =
            "--refine: the blocks have no objects in common; without --refine their clouds are joined as they are";
        return Err(CliError::msg(what));
    }
    match (&args.refine, config) {
        (Some(run), Some(config)) => {
            let resume = is_begun(run, &joined.scene)?;
            let job = PipelineJob { data, out: run.clone(), config, resume, accept_changed_data: false };
            let interrupt = Interrupt::on_ctrl_c()?;
            let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
            joined.scene = refine_scene(&session, &job, &joined.scene)?;
            copy_file(&job.folder().scene(), &args.out)?;
        }
        _ => save_scene(&args.out, &joined.scene)?,
    }
    device::check_validation(&gpu)?;
    report(args, joined, printer)
}

/// Cameras of the whole data set's training views; none, with a warning, if it is not at hand and not needed.
fn cameras(data: &Path, args: &JoinArgs, printer: &Printer) -> Result<Vec<Camera>, CliError> {
    match read_views(data) {
        Ok(dataset) => Ok(dataset.split(Split::Train).map(|view| view.camera.clone()).collect()),
        Err(error) if args.data.is_some() || args.refine.is_some() => Err(error.into()),
        Err(error) => {
            printer.warning(format_args!("{error}; templates are compared without pictures (name it with --data)"));
            Ok(Vec::new())
        }
    }
}

/// True if the refinement of this very scene has begun in the folder: then it goes on.
///
/// # Errors
/// The folder holds a run of another scene, or of another kind.
fn is_begun(run: &Path, scene: &InstancedScene) -> Result<bool, IoError> {
    let folder = RunFolder::new(run);
    let is_refinement = folder.initial_scene().is_file() && !folder.plain_cloud_run().path().exists();
    if is_refinement && load_scene(&folder.initial_scene())?.scene.shows_the_same(scene) {
        return Ok(true);
    }
    match folder.trace_of_run() {
        Some(found) => {
            let error = IoError::new(run, format!("holds another run ({found})"));
            Err(error.advise("choose another folder for --refine"))
        }
        None => Ok(false),
    }
}

impl JoinArgs {
    /// The configuration of the refinement.
    fn refine_config(&self, first_scene: &Path) -> Result<RunConfig, CliError> {
        let of_run = first_scene.parent().map(|run| RunFolder::new(run).config()).filter(|path| path.is_file());
        let file = self.config.clone().or_else(|| of_run.map(|path| path.display().to_string()));
        let Some(file) = file else {
            return Err(CliError::msg("--refine: the first block's scene has no config.toml beside it; give --config"));
        };
        let mut builder = ConfigBuilder::new().file(&file)?.flag("--refine", "method", Method::Instanced.name())?;
        // The bounds of a block's growth are not those of the whole, which has grown already.
        builder = builder.flag("--refine", "joint.grow_fraction", 0.0)?.flag("--refine", "densify.recycle", 0.0)?;
        for assignment in &self.set {
            builder = builder.set(assignment)?;
        }
        let steps = i64::from(self.refine_steps);
        let mut config = builder.flag("--refine-steps", "joint.steps", steps)?.finish()?;
        config.train.init_scene = None;
        config.pipeline.groups = None;
        config.pipeline.masks = None;
        Ok(config)
    }
}

fn report(args: &JoinArgs, joined: Joined, printer: &Printer) -> Result<(), CliError> {
    let Joined { scene, report } = joined;
    let report = Report {
        out: args.out.display().to_string(),
        instances: scene.instances.len(),
        gaussians: scene.source_len(),
        expanded: scene.expanded_len(),
        joined: report,
    };
    if args.json {
        return printer.json(&report);
    }
    let mut table = Table::default();
    table.row(["block", "instances", "background", "outside", "covered"].map(String::from));
    for block in &report.joined.blocks {
        let counts = [block.instances, block.background, block.outside, block.covered];
        let [instances, background, outside, covered] = counts.map(|count| grouped(count as u64));
        table.row([block.name.clone(), instances, background, outside, covered]);
    }
    printer.line(table);
    for kind in &report.joined.templates {
        let name = kind.name.as_deref().unwrap_or("object");
        let (instances, gaussians) = (grouped(kind.instances as u64), grouped(kind.gaussians as u64));
        printer.line(format_args!(
            "{name}: one template of {gaussians} Gaussians for {instances} instances, from {} of the blocks' templates",
            kind.templates
        ));
    }
    printer.line(format_args!(
        "{}: {} instances, {} Gaussians, {} expanded; {} duplicates left out",
        report.out,
        grouped(report.instances as u64),
        grouped(report.gaussians as u64),
        grouped(report.expanded),
        grouped(report.joined.duplicates as u64)
    ));
    Ok(())
}
