//! `instgs-vk tables`: runs the comparison over a list of scenes, and writes the results as tables and plots.

use std::path::{Path, PathBuf};

use clap::Args;

mod files;
mod kept;
mod named_lpips;
mod scene;

use self::files::write_all;
use self::named_lpips::NamedLpips;
use self::scene::{Earlier, Evidence, earlier, run_scene};
use super::comparison::Rival;
use crate::origin::Origin;
use crate::results::scene_list::Source;
use crate::results::{ListError, SceneJob, SceneList, SceneResult, plots, tables};
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
/// can continue; what another build of the program or another device has made is not taken for it. After every scene
/// the tables are written for all scenes of LIST that this program has measured so far, also with --only.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk tables configs/rescene.toml --size ci --out out/tables\n  \
    instgs-vk tables configs/rescene.toml --size ci --only cars,hall --out out/tables\n  \
    instgs-vk tables configs/rescene.toml --size ci --also same-bytes,spz --no-ablations --out out/tables\n  \
    instgs-vk tables configs/results.toml --size long --seeds 0,1,2 --also at-once --out out/results\n  \
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
    let in_size = |what: ListError| CliError::msg(format!("--size: {what}"));
    let size = list.size(&args.size).map_err(in_size)?;
    let folder = args.list.parent().unwrap_or(Path::new(""));
    let mut jobs = list.jobs(folder, &args.size).map_err(in_size)?;
    jobs.iter_mut().for_each(|job| job.ablations &= !args.no_ablations);
    let chosen = measurable(chosen(&jobs, &args.only)?, printer)?;
    let weights = args.lpips.weights();
    if let Err(reason) = &weights {
        printer.line(format_args!("without LPIPS: {reason}"));
    }
    let named = |path: PathBuf| NamedLpips::new(args.lpips.load(&path)?, &path);
    let lpips = weights.ok().map(named).transpose()?;
    let interrupt = Interrupt::on_ctrl_c()?;
    let gpu = device::open(device_args.choice())?;
    create_folder(&args.out)?;
    let (session, origin) = (Session { gpu: &gpu, interrupt: &interrupt, printer }, Origin::here(gpu.caps())?);
    let (seeds, also, out) = (args.seeds.as_slice(), args.also.as_slice(), args.out.as_path());
    let evidence = Evidence { session, list: &list, size, seeds, also, out, lpips, origin };
    // The tables of all scenes must not shrink to those that are measured now.
    let mut results: Vec<Option<SceneResult>> = Vec::new();
    for (place, job) in jobs.iter().enumerate() {
        results.push(match earlier(&evidence, job)? {
            Earlier::Fits(result) => Some(*result),
            Earlier::Other(what) if !chosen.contains(&place) => {
                let name = &job.name;
                printer.warning(format_args!("{name}: its earlier result is of {what}, and is left out of the tables"));
                None
            }
            Earlier::Other(_) | Earlier::Nothing => None,
        });
    }
    for (i, &place) in chosen.iter().enumerate() {
        printer.line(format_args!("scene {} of {}: {}", i + 1, chosen.len(), jobs[place].name));
        results[place] = Some(run_scene(&evidence, &jobs[place])?);
        write_all(out, &there(&results), &args.note, printer)?;
    }
    let results = there(&results);
    device::check_validation(&gpu)?;
    if args.json {
        return printer.json(&results);
    }
    print(&results, &args.out, printer);
    Ok(())
}

/// The results that are there, in the order of the list.
fn there(results: &[Option<SceneResult>]) -> Vec<SceneResult> {
    results.iter().flatten().cloned().collect()
}

/// Those of the chosen jobs whose data sets are on this machine or can be made; an error if there are none.
fn measurable(chosen: Vec<Chosen<'_>>, printer: &Printer) -> Result<Vec<usize>, CliError> {
    let places: Vec<usize> = chosen.iter().filter(|c| is_there(c.job, printer)).map(|c| c.place).collect();
    if places.is_empty() {
        let names: Vec<&str> = chosen.iter().map(|c| c.job.name.as_str()).collect();
        let what = format!("there is nothing to measure: no data set of {} is on this machine", names.join(", "));
        return Err(CliError::msg(what));
    }
    Ok(places)
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

/// A job to be done, and its place in the list.
#[derive(Debug)]
struct Chosen<'a> {
    place: usize,
    job: &'a SceneJob,
}

/// The jobs whose names begin with one of `only`; all if `only` is empty.
fn chosen<'a>(jobs: &'a [SceneJob], only: &[String]) -> Result<Vec<Chosen<'a>>, CliError> {
    if jobs.is_empty() {
        return Err(CliError::msg("there is nothing to measure: the list has no scenes"));
    }
    let fits = |job: &SceneJob| only.is_empty() || only.iter().any(|start| job.name.starts_with(start.as_str()));
    let all = jobs.iter().enumerate().map(|(place, job)| Chosen { place, job });
    let kept: Vec<Chosen<'_>> = all.filter(|chosen| fits(chosen.job)).collect();
    if kept.is_empty() {
        let names: Vec<&str> = jobs.iter().map(|job| job.name.as_str()).collect();
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
    printer.line("");
    plots::bars(results).iter().for_each(|line| printer.line(line));
    printer.line(format_args!("\ntables, plots and pictures: {}", out.display()));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Part;

    fn job(name: &str, source: Source) -> SceneJob {
        SceneJob {
            name: name.into(),
            source,
            true_groups: false,
            part: Part::Scene,
            set: Vec::new(),
            more_steps: None,
            ablations: false,
        }
    }

    #[test]
    fn scenes_keep_their_places_and_nothing_left_is_an_error() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let synth = Source::Synth { recipe: "cars".into(), seed: 1, instances: None, differences: 1.0 };
        let jobs = [
            job("gone", Source::Folder(folder.path().join("gone"))),
            job("room", Source::Folder(folder.path().into())),
            job("cars_1", synth),
        ];
        let printer = Printer::new(true);
        let places = |only: &[&str]| {
            let only: Vec<String> = only.iter().map(|&name| name.into()).collect();
            measurable(chosen(&jobs, &only)?, &printer).map_err(Box::<dyn std::error::Error>::from)
        };
        assert_eq!(places(&[])?, [1, 2]);
        assert_eq!(places(&["cars"])?, [2]);
        let text = |only: &[&str]| places(only).expect_err("nothing is left").to_string();
        assert!(text(&["gone"]).contains("nothing to measure: no data set of gone"));
        assert!(text(&["boat"]).contains("no scene begins with boat; the list has gone, room, cars_1"));
        assert!(chosen(&[], &[]).is_err_and(|e| e.to_string().contains("has no scenes")));
        Ok(())
    }

    /// Measured in another order, and one not at all: the tables have the others in the order of the list.
    #[test]
    fn results_are_in_the_order_of_the_list() {
        let mut results = vec![None; 3];
        for (place, name) in [(2, "c"), (0, "a")] {
            results[place] = Some(SceneResult { name: name.into(), ..SceneResult::default() });
        }
        let names: Vec<String> = there(&results).into_iter().map(|scene| scene.name).collect();
        assert_eq!(names, ["a", "c"]);
    }
}
