//! `instgs-vk tables`: runs the comparison over a list of scenes, and writes the results as tables and plots.

use std::path::{Path, PathBuf};

use clap::Args;

mod files;
mod scene;

use self::files::write_all;
use self::scene::{Evidence, run_scene};
use super::comparison::Rival;
use crate::results::scene_list::Source;
use crate::results::{SceneJob, SceneList, SceneResult, plots, tables};
use instgs_cli::lpips_args::LpipsArgs;
use instgs_cli::training::Session;
use instgs_console::args::create_folder;
use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::Table;
use instgs_console::{CliError, Printer};
use instgs_train::interrupt::Interrupt;

/// Measures a list of scenes and writes the tables that claims are based on.
///
/// For every scene of LIST: a data set (ray-traced into OUT/data, or an existing one), a plain cloud, the instanced
/// scene made from it, and the scenes it is compared with: 3DGS trained on for the same time, and in one run;
/// 3DGS-MCMC; 3DGS of the same bytes; 3DGS quantised per Gaussian (.spz); copies without offsets. Scenes that ask for
/// it are trained again with other settings (ablations). OUT gets tables.md, tables.json, a .csv for each table, plots
/// as .svg, and scenes/NAME/ with all runs and pictures.png. Finished work is not repeated, so that an interrupted run
/// can continue; after every scene the tables are written for all scenes so far.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk tables configs/rescene.toml --size ci --out out/tables\n  \
    instgs-vk tables configs/rescene.toml --size ci --only cars,hall --out out/tables\n  \
    instgs-vk tables configs/rescene.toml --size ci --also same-bytes,spz --no-ablations --out out/tables\n  \
    instgs-vk tables configs/bench/ci.toml --out out/bench")]
pub(super) struct TablesArgs {
    /// List of scenes, a TOML file
    #[arg(value_name = "LIST")]
    list: PathBuf,
    /// Folder for data, runs and tables; created if necessary
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Size of pictures and runs, by its name in the list
    #[arg(long, value_name = "NAME", default_value = "ci")]
    size: String,
    /// Only scenes whose names begin with one of these
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    only: Vec<String>,
    /// Seeds of training; results are medians over them
    #[arg(long, value_name = "S,S,...", value_delimiter = ',', default_value = "0")]
    seeds: Vec<u64>,
    /// Further scenes to compare with, as far as the kind of scene has them
    #[arg(long, value_enum, value_name = "RIVAL,...", value_delimiter = ',', default_values_t = Rival::ALL)]
    also: Vec<Rival>,
    /// Skip the ablations that scenes ask for
    #[arg(long)]
    no_ablations: bool,
    /// Line at the top of the tables, for instance machine and commit
    #[arg(long, value_name = "TEXT", default_value = "")]
    note: String,
    #[command(flatten)]
    lpips: LpipsArgs,
    /// All results as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

pub(super) fn run(args: &TablesArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let list = SceneList::read(&args.list)?;
    let size = list.size(&args.size).map_err(|what| CliError::msg(format!("--size: {what}")))?;
    let folder = args.list.parent().unwrap_or(Path::new(""));
    let mut jobs = chosen(list.jobs(folder, size), &args.only)?;
    jobs.retain(|job| is_there(job, printer));
    jobs.iter_mut().for_each(|job| job.ablations &= !args.no_ablations);
    let weights = args.lpips.weights();
    if let Err(reason) = &weights {
        printer.line(format_args!("without LPIPS: {reason}"));
    }
    let lpips = weights.ok().map(|path| args.lpips.load(&path)).transpose()?;
    let interrupt = Interrupt::on_ctrl_c()?;
    let gpu = device::open(device_args.choice())?;
    create_folder(&args.out)?;
    let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
    let evidence = Evidence { session, list: &list, size, seeds: &args.seeds, also: &args.also, out: &args.out, lpips };
    let mut results: Vec<SceneResult> = Vec::new();
    for (i, job) in jobs.iter().enumerate() {
        printer.line(format_args!("scene {} of {}: {}", i + 1, jobs.len(), job.name));
        results.push(run_scene(&evidence, job)?);
        write_all(&args.out, &results, &args.note, printer)?;
    }
    device::check_validation(&gpu)?;
    if args.json {
        return printer.json(&results);
    }
    print(&results, &args.out, printer);
    Ok(())
}

/// False, with a warning, for a data set that is not on this machine.
fn is_there(job: &SceneJob, printer: &Printer) -> bool {
    match &job.source {
        Source::Folder(folder) if !folder.is_dir() => {
            printer.warning(format_args!(
                "{}: there is no folder {}; the scene is left out",
                job.name,
                folder.display()
            ));
            false
        }
        _ => true,
    }
}

/// The jobs whose names begin with one of `only`; all if `only` is empty.
fn chosen(jobs: Vec<SceneJob>, only: &[String]) -> Result<Vec<SceneJob>, CliError> {
    let names: Vec<String> = jobs.iter().map(|job| job.name.clone()).collect();
    let fits = |job: &SceneJob| only.is_empty() || only.iter().any(|start| job.name.starts_with(start.as_str()));
    let kept: Vec<SceneJob> = jobs.into_iter().filter(fits).collect();
    if kept.is_empty() {
        let what = format!("--only: no scene begins with {}; the list has {}", only.join(" or "), names.join(", "));
        return Err(CliError::msg(what));
    }
    Ok(kept)
}

fn print(results: &[SceneResult], out: &Path, printer: &Printer) {
    for sheet in tables::all(results) {
        printer.line(format_args!("\n{}", sheet.title));
        let mut table = Table::default();
        sheet.lines().into_iter().for_each(|line| table.row(line));
        printer.line(table);
    }
    printer.line("\nInstGS above (+) or below (-) 3DGS of the same time, dB:");
    plots::bars(results).iter().for_each(|line| printer.line(line));
    printer.line(format_args!("\ntables, plots and pictures: {}", out.display()));
}
