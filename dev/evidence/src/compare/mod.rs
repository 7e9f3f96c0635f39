//! `instgs-vk compare`: trains an instanced scene and the plain clouds that it must be measured against, and measures.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

mod runs;
mod seed;
mod summary;
mod timing;

pub(super) use self::runs::{Runs, work_seconds};
use self::seed::compare_seed;
use self::summary::{markdown, print_summary, summary};
use super::args::create_folder;
use super::device::{self, DeviceArgs};
use super::error::CliError;
use super::printer::Printer;
use super::train::{MaskArgs, Session, absolute};
use crate::bench::comparison::SeedResult;
use crate::eval::{Evaluated, Lpips};
use crate::io::{Dataset, IoError, Split, View, read_views};
use crate::train::config::{ConfigBuilder, Method, TrainConfig};
use crate::train::interrupt::Interrupt;
use crate::train::leave_out_masked;

/// Compares an instanced scene with plain clouds that had as much time, or may have as many bytes.
///
/// For each seed: the plain cloud and the instanced scene made of it; the cloud trained on for as long as the instanced
/// scene took in all; a cloud whose .ply is not larger than the instanced scene packed as f16, trained as long. All are
/// rendered from the test views by the same renderer. OUT gets seed_S/ with a run folder each, compare.json and
/// compare.md; what is there already is not trained again.
#[derive(Args)]
#[command(after_help = "Example:\n  \
    instgs-vk compare --data cars --out out/compare --config instgs_quick --seeds 0,1,2\n  \
    instgs-vk compare --data cars --groups cars/groups.json --out out/compare_given --config instgs_quick\n  \
    instgs-vk compare --data cars --boxes boxes.json --out out/compare_boxes --config instgs_quick")]
pub(super) struct CompareArgs {
    /// Dataset folder
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// groups.json: which objects are alike, and where they stand [default: found from the masks]
    #[arg(long, value_name = "JSON")]
    groups: Option<PathBuf>,
    #[command(flatten)]
    masks: MaskArgs,
    /// Folder for runs and results; made if it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A preset or a TOML file
    #[arg(long, value_name = "F", default_value = "instgs")]
    config: String,
    /// One value of the configuration; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seeds, one comparison each; figures are medians over them
    #[arg(long, value_name = "S,S,...", value_delimiter = ',', default_value = "0")]
    seeds: Vec<u64>,
    /// Timed frames of each scene; 0 = none
    #[arg(long, value_name = "N", default_value = "24")]
    frames: u32,
    /// Train the plain cloud on for N steps, instead of for the time that the instanced scene took: on a busy machine, or
    /// to get the same figures again
    #[arg(long, value_name = "N")]
    more_steps: Option<u64>,
    /// What else is measured beside the instanced scene and the plain cloud that had the same time
    #[arg(long, value_enum, value_name = "RIVAL,...", value_delimiter = ',', default_value = "same-bytes")]
    also: Vec<Rival>,
    /// Measure nothing else
    #[arg(long, conflicts_with = "also")]
    alone: bool,
    /// Results as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// What is measured beside the instanced scene, its start, and the cloud that had the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Rival {
    /// A plain cloud whose .ply is not larger than the instanced scene packed as f16
    SameBytes,
    /// A plain cloud of as many steps as the cloud that had the same time, trained in one piece
    AtOnce,
    /// The same by 3DGS-MCMC
    Mcmc,
    /// The cloud that had the same time as .spz: every Gaussian quantised for itself
    Spz,
    /// The same as .instgs, packed as small
    Small,
    /// Templates and poses without offsets
    Rigid,
}

impl Rival {
    /// In the order of the tables.
    pub(super) const ALL: [Self; 6] = [Self::AtOnce, Self::Mcmc, Self::SameBytes, Self::Spz, Self::Small, Self::Rigid];
}

/// What is compared.
pub(super) struct Comparison {
    /// Dataset folder.
    pub(super) data: PathBuf,
    /// Folder for runs and results.
    pub(super) out: PathBuf,
    /// Of the instanced runs, the seed apart.
    pub(super) config: TrainConfig,
    /// One comparison each.
    pub(super) seeds: Vec<u64>,
    /// Timed frames; 0 = none.
    pub(super) frames: u32,
    /// Steps that the plain cloud is trained on; `None` = by the clock.
    pub(super) more_steps: Option<u64>,
    /// What else is measured.
    pub(super) rivals: Vec<Rival>,
    /// The network of LPIPS.
    pub(super) lpips: Option<Lpips>,
}

pub(super) fn run(args: &CompareArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let comparison = args.comparison()?;
    let interrupt = Interrupt::on_ctrl_c().map_err(|e| CliError::Other(e.to_string()))?;
    let gpu = device::open(device_args.choice())?;
    let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
    let results = compare(&session, &comparison, &mut |_, _| ())?;
    device::check_validation(&gpu)?;
    if args.json { printer.json(&results) } else { Ok(()) }
}

impl CompareArgs {
    fn comparison(&self) -> Result<Comparison, CliError> {
        let mut builder = ConfigBuilder::new().file(&self.config)?;
        for assignment in &self.set {
            builder = builder.set(assignment)?;
        }
        if let Some(groups) = &self.groups {
            builder = builder.flag("--groups", "groups", absolute("--groups", groups)?)?;
        }
        builder = self.masks.put_into(builder)?;
        // What a configuration takes as a seed is its own matter.
        for &seed in &self.seeds {
            builder = builder.flag("--seeds", "seed", as_i64(seed)?)?;
        }
        let config = TrainConfig { method: Method::Instanced, seed: 0, ..builder.finish()? };
        if !config.init_scene.is_empty() {
            let what = "compare trains its own plain cloud, of which it knows the time: leave out init_scene";
            return Err(CliError::Other(what.into()));
        }
        Ok(Comparison {
            data: self.data.clone(),
            out: self.out.clone(),
            config,
            seeds: self.seeds.clone(),
            frames: self.frames,
            more_steps: self.more_steps,
            rivals: if self.alone { Vec::new() } else { self.also.clone() },
            lpips: None,
        })
    }
}

fn as_i64(seed: u64) -> Result<i64, CliError> {
    i64::try_from(seed).map_err(|_| CliError::Other(format!("--seeds: {seed} is too large")))
}

/// Trains and measures for every seed; writes compare.json and compare.md and prints the table. `on_picture` gets the rows'
/// name and each test view of the first seed.
pub(super) fn compare(
    session: &Session<'_>,
    comparison: &Comparison,
    on_picture: &mut dyn FnMut(&str, &Evaluated<'_>),
) -> Result<Vec<SeedResult>, CliError> {
    let views = test_views(session, comparison)?;
    create_folder(&comparison.out)?;
    keep_config(comparison)?;
    let mut results = Vec::new();
    for (i, &seed) in comparison.seeds.iter().enumerate() {
        let mut first_only = |name: &str, view: &Evaluated<'_>| {
            if i == 0 {
                on_picture(name, view);
            }
        };
        results.push(compare_seed(session, (comparison, &views), seed, &mut first_only)?);
        session.printer.json_file(&comparison.out.join("compare.json"), &results)?;
    }
    let table = summary(&results);
    let markdown = markdown(&table);
    crate::io::atomic_write(&comparison.out.join("compare.md"), |out| out.write_all(markdown.as_bytes()))?;
    print_summary(&table, &results, session.printer);
    Ok(results)
}

/// The views that are compared. Before anything is trained for them.
fn test_views(session: &Session<'_>, comparison: &Comparison) -> Result<Vec<View>, CliError> {
    let mut views: Vec<View> = Dataset::split(&read_views(&comparison.data)?, Split::Test).cloned().collect();
    let width = (comparison.config.width > 0).then_some(comparison.config.width);
    let masked = leave_out_masked(&mut views, width)?;
    masked.iter().for_each(|text| session.printer.warning(text));
    if views.is_empty() {
        let error = IoError::new(&comparison.data, "has no test views to compare");
        return Err(error.advise("add a test split, or photos: every eighth of more than eight is one").into());
    }
    Ok(views)
}

/// Writes down what is compared; refuses a folder with runs of something else, which would be taken for results of this.
fn keep_config(comparison: &Comparison) -> Result<(), CliError> {
    let path = comparison.out.join("config.toml");
    let data = std::fs::canonicalize(&comparison.data).unwrap_or_else(|_| comparison.data.clone());
    let more = comparison.more_steps.map_or("by the clock".into(), |steps| steps.to_string());
    let text = format!("# data: {}\n# more steps: {more}\n{}", data.display(), comparison.config.to_toml()?);
    match std::fs::read(&path) {
        Ok(there) if there != text.as_bytes() => {
            let error = IoError::new(&path, "is of another comparison");
            Err(error.advise("repeat it with the same configuration, or choose another --out").into())
        }
        Ok(_) => Ok(()),
        Err(_) => Ok(crate::io::atomic_write(&path, |out| out.write_all(text.as_bytes()))?),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        compare: CompareArgs,
    }

    /// Results of one comparison are not taken for those of another.
    #[test]
    fn a_folder_of_another_comparison_is_refused() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let out = folder.path().display().to_string();
        let keep = |words: &str| {
            let words = format!("x --out {out} --masks m {words}");
            let line = Line::try_parse_from(words.split_whitespace())?;
            Ok::<_, Box<dyn std::error::Error>>(keep_config(&line.compare.comparison()?))
        };
        keep("--data d --set steps=9")??;
        let kept = std::fs::read(folder.path().join("config.toml"))?;
        keep("--data d --set steps=9")??;
        for other in ["--data d --set steps=8", "--data e --set steps=9", "--data d --set steps=9 --more-steps 4"] {
            let text = keep(other)?.expect_err(other).to_string();
            assert!(text.contains("config.toml") && text.contains("another comparison"), "{text}");
        }
        assert_eq!(std::fs::read(folder.path().join("config.toml"))?, kept);
        Ok(())
    }

    /// Masks come from where `train` may have them from.
    #[test]
    fn boxes_and_words_reach_the_configuration() -> Result<(), Box<dyn std::error::Error>> {
        let comparison = |words: &str| {
            let words = format!("x --data d --out o {words}");
            Line::try_parse_from(words.split_whitespace()).map(|line| line.compare.comparison())
        };
        let boxes = comparison("--boxes /b.json --groups /g.json")??.config;
        assert_eq!([boxes.boxes, boxes.groups, boxes.masks], ["/b.json", "/g.json", ""]);
        let words = comparison("--prompt car. --models /n")??.config;
        assert_eq!([words.prompt, words.models, words.boxes], ["car.", "/n", ""]);
        assert!(comparison("--boxes b.json --masks m").is_err());
        Ok(())
    }
}
