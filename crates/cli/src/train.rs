//! `instgs-vk train`: makes a scene from photos.

use std::path::{Path, PathBuf};

use clap::Args;

use super::dry_run;
use super::mask_args::MaskArgs;
use super::run_name;
use super::training::{Session, train_job};
use instgs_console::args::absolute;
use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_io::RunFolder;
use instgs_objects::pipeline::PipelineJob;
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_report::RunReport;
use instgs_train::config::Method;
use instgs_train::interrupt::Interrupt;
use instgs_train::unused_masks;

/// Trains a scene of Gaussians from photos with known cameras.
///
/// DATA holds transforms.json (or transforms_train.json and transforms_test.json), or a COLMAP model in sparse/0 with
/// images/. RUN gets config.toml, checkpoints/, events.jsonl, point_cloud.ply, scene.instgs, trained.json, report.json,
/// report.html and renders/ of the test views. Ctrl-C writes a checkpoint; --resume continues from the newest one.
///
/// With --method instgs, repeated objects become instances of shared templates. First the plain cloud is trained in
/// RUN/vanilla (or taken from --init). Masks then give the object of each Gaussian; their ids need not be the same from
/// view to view. Objects that are alike are registered to each other, unless --groups gives their poses. Last,
/// templates, offsets, background and poses are optimised together. Every stage leaves a file, from which --resume
/// continues, and pictures in RUN/stages, which report.html shows too.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk train fox --config quick --width 270\n  \
    instgs-vk train cars --config instgs_quick --dry-run\n  \
    instgs-vk train cars --config instgs_quick --out runs/cars\n  \
    instgs-vk train cars --out runs/cars --resume\n  \
    instgs-vk train garden --set strategy=mcmc --max-gaussians 500000\n  \
    instgs-vk train hall --groups hall/groups.json --config instgs_sparse")]
pub(super) struct TrainArgs {
    /// Dataset folder with photos and cameras
    #[arg(value_name = "DATA", required_unless_present = "data_flag", conflicts_with = "data_flag")]
    data: Option<PathBuf>,
    /// Dataset folder, as a flag instead of the argument DATA
    #[arg(id = "data_flag", long = "data", value_name = "DATA")]
    data_flag: Option<PathBuf>,
    /// Run folder; created if necessary [default: runs/NAME-DATE, NAME being the data set's; with a number behind it where
    /// that folder exists]
    #[arg(long, value_name = "RUN")]
    out: Option<PathBuf>,
    /// Kind of scene: 3dgs, a plain cloud, or instgs, templates with instances
    #[arg(long, value_name = "METHOD")]
    method: Option<String>,
    /// Start from this scene instead of the dataset's points
    #[arg(long, value_name = "SCENE")]
    init: Option<PathBuf>,
    /// A preset (default, quick, paper, mcmc, instgs, instgs_quick, instgs_early, instgs_renders, instgs_sparse) or a TOML file
    #[arg(long, value_name = "F")]
    config: Option<String>,
    /// One value of the configuration, for instance --set rates.means=1e-4; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    masks: MaskArgs,
    /// groups.json: groups of alike objects with their poses; for instgs [default: found by registration]
    #[arg(long, value_name = "JSON")]
    groups: Option<PathBuf>,
    /// Optimisation steps; with instgs, those of the plain cloud
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Optimisation steps of the joint phase; for instgs
    #[arg(long, value_name = "N")]
    joint_steps: Option<u64>,
    /// Downscale training pictures to this width
    #[arg(long, value_name = "W")]
    width: Option<u32>,
    /// Leave out views without a photo, however many they are; up to half of them always are
    #[arg(long)]
    skip_missing: bool,
    /// Folder of masks of the pixels that count: black ones are neither trained on nor compared
    #[arg(long, value_name = "DIR")]
    pixel_masks: Option<PathBuf>,
    /// Seed of all random choices
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Upper bound of the number of Gaussians
    #[arg(long, value_name = "N")]
    max_gaussians: Option<u32>,
    /// Evaluate the test views every N steps, and at the end
    #[arg(long, value_name = "N")]
    eval_every: Option<u64>,
    /// Continue from the newest checkpoint of RUN with RUN's configuration and seed; flags given now take precedence
    #[arg(long, requires = "out")]
    resume: bool,
    /// Continue although photos, masks of pixels or cameras are not those that RUN began with
    #[arg(long, requires = "resume")]
    accept_changed_data: bool,
    /// Say what would be used (photos, masks, steps, memory) and stop; nothing is written
    #[arg(long, conflicts_with = "resume")]
    dry_run: bool,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

impl TrainArgs {
    /// Folder of the data set; clap has seen to it that there is one.
    fn data(&self) -> &Path {
        self.data.as_ref().or(self.data_flag.as_ref()).map_or(Path::new(""), PathBuf::as_path)
    }

    fn resolved(&self) -> Result<RunConfig, CliError> {
        let own = self.out.as_ref().map(|out| RunFolder::new(out).config()).filter(|own| self.resume && own.is_file());
        let mut builder = ConfigBuilder::new();
        if let Some(own) = own {
            builder = builder.run_file(&own)?;
        }
        if let Some(file) = &self.config {
            builder = builder.file(file)?;
        }
        for assignment in &self.set {
            builder = builder.set(assignment)?;
        }
        builder = self.masks.put_into(builder)?;
        if let Some(method) = &self.method {
            builder = builder.flag("--method", "method", method.as_str())?;
        }
        if self.skip_missing {
            builder = builder.flag("--skip-missing", "skip_missing", true)?;
        }
        let paths = [
            ("--init", "init_scene", &self.init),
            ("--groups", "groups", &self.groups),
            ("--pixel-masks", "pixel_masks", &self.pixel_masks),
        ];
        for (flag, key, path) in paths {
            if let Some(path) = path {
                builder = builder.flag(flag, key, absolute(flag, path)?)?;
            }
        }
        let numbers = [
            ("--steps", "steps", self.steps),
            ("--joint-steps", "joint.steps", self.joint_steps),
            ("--width", "width", self.width.map(u64::from)),
            ("--seed", "seed", self.seed),
            ("--max-gaussians", "max_gaussians", self.max_gaussians.map(u64::from)),
            ("--eval-every", "eval_every", self.eval_every),
        ];
        for (flag, key, value) in numbers {
            if let Some(value) = value {
                let value = i64::try_from(value).map_err(|_| CliError::msg(format!("{flag}: {value} is too large")))?;
                builder = builder.flag(flag, key, value)?;
            }
        }
        let config = builder.finish()?;
        self.check_method(config.train.method)?;
        if self.masks.has_models() && config.pipeline.prompt.is_none() {
            return Err(CliError::msg("--models is the folder that --prompt needs: give --prompt, too"));
        }
        Ok(config)
    }

    /// Refuses flags that the method does not use.
    fn check_method(&self, method: Method) -> Result<(), CliError> {
        let of_groups = [("--groups", self.groups.is_some()), ("--joint-steps", self.joint_steps.is_some())];
        let given = self.masks.given().chain(of_groups).find(|(_, given)| *given);
        match (method, given) {
            (Method::Gaussians, Some((flag, _))) => Err(CliError::msg(format!(
                "{flag} is for templates and instances, and this run trains a plain cloud; add --method instgs, or a \
                 preset that has it (--config instgs_quick)"
            ))),
            _ => Ok(()),
        }
    }

    /// Refuses a folder given by `--out` that holds a run, unless that is to be resumed; warns if there is none to resume.
    fn check_folder(&self, printer: &Printer) -> Result<(), CliError> {
        match &self.out {
            Some(out) if !self.resume => Ok(RunFolder::new(out).expect_no_run()?),
            Some(out) if RunFolder::new(out).trace_of_run().is_none() => {
                printer.warning(format_args!("{} holds no run to resume: a new one begins", out.display()));
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

pub(super) fn run(args: &TrainArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let (config, data) = (args.resolved()?, args.data());
    args.check_folder(printer)?;
    if args.steps.is_some() && config.train.method == Method::Instanced && config.train.init_scene.is_some() {
        printer.warning("--steps are those of the plain cloud, which is given (--init): only --joint-steps are done");
    }
    let job = |out| PipelineJob {
        data: data.into(),
        out,
        config: config.clone(),
        resume: args.resume,
        accept_changed_data: args.accept_changed_data,
    };
    if args.dry_run {
        let out = args.out.clone().unwrap_or_else(|| run_name::unused(data));
        return dry_run::run(&job(out), device_args, args.json, printer);
    }
    // Checked before anything is written: a folder without cameras should not leave an empty run.
    let dataset = instgs_io::read_views(data)?;
    unused_masks(data, &config.train, &dataset.views).iter().for_each(|note| printer.warning(note));
    let interrupt = Interrupt::on_ctrl_c()?;
    let gpu = device::open(device_args.choice())?;
    let job = job(match &args.out {
        Some(out) => out.clone(),
        None => run_name::claim(data)?,
    });
    // Before a lock is put there.
    job.check_folders()?;
    if args.out.is_none() {
        printer.line(format_args!("the run folder is {}", job.out.display()));
    }
    let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
    let report = train_job(&session, &job).inspect_err(|_| {
        if args.out.is_none() {
            // Only if it is empty: nobody asked for a folder of a run that never began.
            let _ = std::fs::remove_dir(&job.out);
        }
    })?;
    if args.json {
        return printer.json(&report);
    }
    print_report(&report, &job.out, printer);
    Ok(())
}

fn print_report(report: &RunReport, out: &Path, printer: &Printer) {
    let mut table = Table::default();
    let mut row = |name: &str, value: String| table.row([name.into(), value]);
    row("steps", format!("{} in {:.1} s, {:.2} a second", report.steps, report.seconds, report.steps_per_second));
    let counts = &report.gaussians;
    if report.vanilla.is_some() {
        let own = if counts.own > 0 { format!("{} of instances' own, ", grouped(counts.own)) } else { String::new() };
        let drawn = match counts.hidden {
            0 => grouped(counts.expanded),
            hidden => format!("{} drawn and {} hidden", grouped(counts.expanded - hidden), grouped(hidden)),
        };
        let text = format!(
            "{} of templates, {} offset records, {own}{} of the background, {drawn} after expanding",
            grouped(counts.template),
            grouped(counts.offsets),
            grouped(counts.background),
        );
        row("Gaussians", text);
    } else {
        row("Gaussians", grouped(counts.background));
    }
    if let Some(eval) = &report.eval {
        let lpips = eval.lpips.map(|v| format!(", LPIPS {v:.3}")).unwrap_or_default();
        let exposed = eval.psnr_exposed.map(|v| format!(" ({v:.2} with the photos' exposures)")).unwrap_or_default();
        row("test views", format!("PSNR {:.2} dB{exposed}, SSIM {:.4}{lpips}", eval.psnr, eval.ssim));
    }
    row("file", format!("{} bytes", grouped(report.bytes.file)));
    row("device, peak", format!("{} bytes", grouped(report.bytes.device_peak)));
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

    fn resolved(out: &Path, more: &[&str]) -> Result<RunConfig, Box<dyn std::error::Error>> {
        let out = out.display().to_string();
        let line = [&["train", "--data", "d", "--out", &out], more].concat();
        Ok(Line::try_parse_from(line)?.args.resolved()?)
    }

    #[test]
    fn a_resumed_run_knows_the_scene_it_started_from() -> Test {
        let folder = tempfile::tempdir()?;
        let here = std::env::current_dir()?;
        let config = resolved(folder.path(), &["--init", "a/../b.ply", "--set", "init_scene=c.ply"])?;
        // The flag takes precedence over --set; links are not resolved.
        assert_eq!(config.train.init_scene, Some(here.join("a/../b.ply")));
        std::fs::write(RunFolder::new(folder.path()).config(), config.to_toml()?)?;
        assert_eq!(resolved(folder.path(), &["--resume"])?.train.init_scene, config.train.init_scene);
        assert_eq!(resolved(folder.path(), &["--resume", "--init", "/x.ply"])?.train.init_scene, Some("/x.ply".into()));
        assert_eq!(resolved(folder.path(), &[])?.train.init_scene, None);
        Ok(())
    }

    #[test]
    fn what_a_plain_cloud_would_not_read_is_refused() -> Test {
        let folder = tempfile::tempdir()?;
        let flags =
            [["--masks", "m"], ["--boxes", "b"], ["--prompt", "car."], ["--groups", "g"], ["--joint-steps", "9"]];
        for flag in flags {
            let error = resolved(folder.path(), &flag).err().ok_or("taken")?.to_string();
            assert!(error.starts_with(flag[0]) && error.contains("--method instgs"), "{error}");
            for method in [["--method", "instgs"], ["--config", "instgs_quick"]] {
                resolved(folder.path(), &[flag, method].concat())?;
            }
        }
        Ok(())
    }
}
