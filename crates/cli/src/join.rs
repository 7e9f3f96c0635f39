//! `instgs-vk join`: makes one scene of trained blocks.

use std::path::{Path, PathBuf};

use clap::Args;

use super::training::{Session, refine_scene};
use instgs_blocks::join::read_runs;
use instgs_blocks::{JoinInput, JoinReport, Joined, join};
use instgs_console::args::create_folder_of;
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
    /// Steps of that training [default: 300]
    #[arg(long, value_name = "N", requires = "refine")]
    refine_steps: Option<u32>,
    /// Configuration of that training: a preset or a TOML file [default: the first block's run's]
    #[arg(long, value_name = "F", requires = "refine")]
    config: Option<String>,
    /// One value of that configuration; may be repeated
    #[arg(long, value_name = "KEY=VALUE", requires = "refine")]
    set: Vec<String>,
    /// Go on with that training although photos, masks of pixels or cameras are not those that it began with
    #[arg(long, requires = "refine")]
    accept_changed_data: bool,
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
    args.refine.as_deref().map_or(Ok(()), check_run)?;
    let cameras = cameras(&data, args, printer)?;
    create_folder_of(&args.out)?;
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
            let accept_changed_data = args.accept_changed_data;
            let job = PipelineJob { data, out: run.clone(), config, resume, accept_changed_data };
            let interrupt = Interrupt::on_ctrl_c()?;
            let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
            if !joined.scene.fitted_levels.is_empty() {
                joined.scene.fitted_levels.clear();
                printer.warning(
                    "--refine changes the templates, so their levels of detail are left out; instgs-vk levels makes new ones",
                );
            }
            joined.scene = refine_scene(&session, &job, &joined.scene).map_err(|error| in_flags_of_join(&error))?;
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
        Ok(dataset) => {
            dataset.notes.iter().for_each(|note| printer.warning(note));
            Ok(dataset.split(Split::Train).map(|view| view.camera.clone()).collect())
        }
        Err(error) if args.data.is_some() || args.refine.is_some() => Err(error.into()),
        Err(error) => {
            printer.warning(format_args!("{error}; templates are compared without pictures (name it with --data)"));
            Ok(Vec::new())
        }
    }
}

/// Refuses a folder that holds a run of another kind, before the work whose result would go there.
///
/// # Errors
/// The folder holds a run that is no refinement.
fn check_run(run: &Path) -> Result<(), IoError> {
    let folder = RunFolder::new(run);
    match folder.trace_of_run().filter(|_| !is_refinement(&folder)) {
        Some(found) => Err(another_run(run, &found)),
        None => Ok(()),
    }
}

/// True if the folder holds a joint phase that no plain cloud came before.
fn is_refinement(folder: &RunFolder) -> bool {
    folder.initial_scene().is_file() && !folder.plain_cloud_run().path().exists()
}

/// The error for a folder with a run that cannot be the refinement.
fn another_run(run: &Path, found: &str) -> IoError {
    IoError::new(run, format!("holds another run ({found})")).advise("choose another folder for --refine")
}

/// True if the refinement of this very scene has begun in the folder: then it goes on.
///
/// # Errors
/// The folder holds a run of another scene, or of another kind.
fn is_begun(run: &Path, scene: &InstancedScene) -> Result<bool, IoError> {
    check_run(run)?;
    let folder = RunFolder::new(run);
    let first = folder.initial_scene();
    if !is_refinement(&folder) {
        return Ok(false);
    }
    match load_scene(&first)?.scene.shows_the_same(scene) {
        true => Ok(true),
        false => Err(another_run(run, "of another scene")),
    }
}

/// The trainer's errors name flags of `train`; the same, by those of `join`.
fn in_flags_of_join(error: &CliError) -> CliError {
    let flags = [
        ("--joint-steps", "--refine-steps"),
        ("--skip-missing", "--set skip_missing=true"),
        ("continue with --resume", "the same command continues"),
        ("(--max-gaussians, in a new run)", "(train the blocks with a smaller --max-gaussians)"),
        ("(--width)", "(--set width=W)"),
        ("or start a new run with --init and its scene", "or choose another folder for --refine"),
    ];
    CliError::msg(flags.iter().fold(error.to_string(), |text, (of_train, own)| text.replace(of_train, own)))
}

/// Steps of the refinement, unless flags say otherwise.
const REFINE_STEPS: i64 = 300;
/// Keys that the refinement does not read, since its objects and its first scene are those of the blocks.
const NOT_READ: [&str; 6] = ["init_scene", "groups", "masks", "boxes", "prompt", "models"];

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
        builder = builder.flag("--refine", "joint.steps", REFINE_STEPS)?;
        // Few steps: poses learn in each.
        builder = builder.flag("--refine", "joint.instances_every", 1)?;
        for assignment in &self.set {
            let key = assignment.split_once('=').map_or("", |(key, _)| key.trim());
            if NOT_READ.contains(&key) {
                return Err(CliError::msg(format!(
                    "--set {assignment}: --refine trains the joined scene, whose objects are known, and does not read {key}; \
                     leave it out"
                )));
            }
            builder = builder.set(assignment)?;
        }
        if let Some(steps) = self.refine_steps {
            builder = builder.flag("--refine-steps", "joint.steps", i64::from(steps))?;
        }
        let mut config = builder.finish()?;
        if config.train.method != Method::Instanced {
            let what = "--set method: --refine trains templates and instances; leave it out";
            return Err(CliError::msg(what));
        }
        // What the block was trained with.
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
    table.row(["block", "instances", "beyond", "background", "outside", "covered"].map(String::from));
    for block in &report.joined.blocks {
        let counts = [block.instances, block.beyond, block.background, block.outside, block.covered];
        let [instances, beyond, background, outside, covered] = counts.map(|count| grouped(count as u64));
        table.row([block.name.clone(), instances, beyond, background, outside, covered]);
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

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    type Test = Result<(), Box<dyn std::error::Error>>;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: JoinArgs,
    }

    fn config(more: &[&str]) -> Result<RunConfig, Box<dyn std::error::Error>> {
        let begin = ["join", "b/run", "--out", "x.instgs", "--refine", "r", "--config", "instgs_quick"];
        let args = Line::try_parse_from([&begin, more].concat())?.args;
        Ok(args.refine_config(Path::new("b/run/scene.instgs"))?)
    }

    #[test]
    fn the_default_of_refine_steps_is_below_set_and_the_flag_above() -> Test {
        let steps = |more: &[&str]| config(more).map(|config| config.train.joint.steps);
        assert_eq!(steps(&[])?, 300);
        assert_eq!(steps(&["--set", "joint.steps=70"])?, 70);
        assert_eq!(steps(&["--set", "joint.steps=70", "--refine-steps", "90"])?, 90);
        Ok(())
    }

    #[test]
    fn what_refining_does_not_read_is_refused() -> Test {
        for key in NOT_READ {
            let error = config(&["--set", &format!("{key} = a")]).err().ok_or(key)?.to_string();
            assert!(error.contains(key) && error.contains("does not read"), "{error}");
        }
        let error = config(&["--set", "method=3dgs"]).err().ok_or("taken")?.to_string();
        assert!(error.contains("--set method"), "{error}");
        config(&["--set", "method=instgs"])?;
        Ok(())
    }

    #[test]
    fn only_a_refinement_is_gone_on_with() -> Test {
        let folder = tempfile::tempdir()?;
        let run = RunFolder::new(folder.path());
        check_run(folder.path())?;
        std::fs::write(run.config(), "")?;
        let error = check_run(folder.path()).err().ok_or("taken")?.to_string();
        assert!(error.contains("holds another run (config.toml)") && error.contains("--refine"), "{error}");
        save_scene(&run.initial_scene(), &InstancedScene::default())?;
        check_run(folder.path())?;
        assert!(is_begun(folder.path(), &InstancedScene::default())?);
        let other = InstancedScene { near_plane: instgs_vk::scene::NearPlane(0.7), ..InstancedScene::default() };
        assert!(is_begun(folder.path(), &other).is_err_and(|e| e.to_string().contains("of another scene")));
        // A run of its own has trained a plain cloud first.
        std::fs::create_dir(run.plain_cloud_run().path())?;
        assert!(check_run(folder.path()).is_err());
        Ok(())
    }

    #[test]
    fn advice_names_flags_that_join_has() -> Test {
        let flags = ["--accept-changed-data", "--refine-steps=9", "--set=skip_missing=true"];
        config(&flags)?;
        let text = |of_train: &str| in_flags_of_join(&CliError::msg(of_train.to_owned())).to_string();
        assert_eq!(text("x; continue with --joint-steps 40 or more"), "x; continue with --refine-steps 40 or more");
        let missing = text("a.png: is missing; put it there, or go on without such photos with --skip-missing");
        assert!(missing.ends_with("with --set skip_missing=true"), "{missing}");
        let stopped = text("the state before it is in c, continue with --resume");
        assert_eq!(stopped, "the state before it is in c, the same command continues");
        Ok(())
    }
}
