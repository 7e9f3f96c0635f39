//! `instgs-vk compare`: compares an instanced scene with plain clouds.

use std::path::PathBuf;

use clap::Args;

use super::comparison::{Comparison, Rival, compare};
use instgs_cli::mask_args::MaskArgs;
use instgs_cli::training::Session;
use instgs_console::args::absolute;
use instgs_console::device::{self, DeviceArgs};
use instgs_console::{CliError, Printer};
use instgs_objects::pipeline::config::ConfigBuilder;
use instgs_train::config::Method;
use instgs_train::interrupt::Interrupt;

/// Compares an instanced scene with plain clouds of the same training time or the same number of bytes.
///
/// For each seed: the plain cloud and the instanced scene made from it; the cloud trained on for as long as the
/// instanced scene took in all; a cloud that packed as f16 is not larger than the instanced scene packed as f16, trained
/// as long. All are rendered from the test views by the same renderer. OUT gets seed_S/ with a run folder each,
/// compare.json and compare.md; runs that exist are not repeated.
#[derive(Args)]
#[command(after_help = "Example:\n  \
    instgs-vk compare --data cars --out out/compare --config instgs_quick --seeds 0,1,2\n  \
    instgs-vk compare --data cars --groups cars/groups.json --out out/compare_given --config instgs_quick\n  \
    instgs-vk compare --data cars --boxes boxes.json --out out/compare_boxes --config instgs_quick")]
pub(super) struct CompareArgs {
    /// Dataset folder with photos and cameras
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// groups.json: groups of alike objects with their poses [default: found from the masks]
    #[arg(long, value_name = "JSON")]
    groups: Option<PathBuf>,
    #[command(flatten)]
    masks: MaskArgs,
    /// Folder for runs and results; created if necessary
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A preset or a TOML file
    #[arg(long, value_name = "F", default_value = "instgs")]
    config: String,
    /// One value of the configuration; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seeds, one comparison each; results are medians over them
    #[arg(long, value_name = "S,S,...", value_delimiter = ',', default_value = "0")]
    seeds: Vec<u64>,
    /// Timed frames of each scene; 0 = none
    #[arg(long, value_name = "N", default_value = "24")]
    frames: u32,
    /// Train the plain cloud on for N steps, instead of for the time that the instanced scene took: on a busy machine,
    /// or for reproducible results
    #[arg(long, value_name = "N")]
    more_steps: Option<u64>,
    /// Further scenes to compare with
    #[arg(long, value_enum, value_name = "RIVAL,...", value_delimiter = ',', default_value = "same-bytes")]
    also: Vec<Rival>,
    /// Compare with no further scenes
    #[arg(long, conflicts_with = "also")]
    alone: bool,
    /// Results as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

pub(super) fn run(args: &CompareArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let comparison = args.comparison()?;
    let interrupt = Interrupt::on_ctrl_c()?;
    let gpu = device::open(device_args.choice())?;
    let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
    let results = compare(&session, &comparison, &mut |_, _| ())?.seeds;
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
        // The range of seeds is left to the configuration.
        for &seed in &self.seeds {
            builder = builder.flag("--seeds", "seed", as_i64(seed)?)?;
        }
        let mut config = builder.flag("compare", "method", Method::Instanced.name())?.finish()?;
        config.train.seed = 0;
        if config.train.init_scene.is_some() {
            let what = "compare trains its own plain cloud, of which it knows the time: leave out init_scene";
            return Err(CliError::msg(what));
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
    i64::try_from(seed).map_err(|_| CliError::msg(format!("--seeds: {seed} is too large")))
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::comparison::keep_config;
    use crate::origin::Origin;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        compare: CompareArgs,
    }

    /// A folder with the results of another comparison, program or device is refused.
    #[test]
    fn a_folder_of_another_comparison_is_refused() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let out = folder.path().display().to_string();
        let here = Origin { program: "0.1.0 (1)".into(), device: "a".into() };
        let keep_of = |words: &str, origin: &Origin| {
            let words = format!("x --out {out} --masks m {words}");
            let line = Line::try_parse_from(words.split_whitespace())?;
            Ok::<_, Box<dyn std::error::Error>>(keep_config(&line.compare.comparison()?, origin))
        };
        let keep = |words: &str| keep_of(words, &here);
        keep("--data d --set steps=9")??;
        let kept = std::fs::read(folder.path().join("config.toml"))?;
        keep("--data d --set steps=9")??;
        for other in ["--data d --set steps=8", "--data e --set steps=9", "--data d --set steps=9 --more-steps 4"] {
            let text = keep(other)?.expect_err(other).to_string();
            assert!(text.contains("config.toml") && text.contains("another comparison"), "{text}");
        }
        let rebuilt = Origin { program: "0.1.0 (2)".into(), ..here.clone() };
        for other in [rebuilt, Origin { device: "b".into(), ..here.clone() }] {
            let text = keep_of("--data d --set steps=9", &other)?.expect_err("another origin").to_string();
            assert!(text.contains("another build") && text.contains("another device"), "{text}");
        }
        assert_eq!(std::fs::read(folder.path().join("config.toml"))?, kept);
        Ok(())
    }

    /// Masks can come from the same sources as for `train`.
    #[test]
    fn boxes_and_words_reach_the_configuration() -> Result<(), Box<dyn std::error::Error>> {
        let comparison = |words: &str| {
            let words = format!("x --data d --out o {words}");
            Line::try_parse_from(words.split_whitespace()).map(|line| line.compare.comparison())
        };
        let boxes = comparison("--boxes /b.json --groups /g.json")??.config.pipeline;
        let path = |path: &str| Some(PathBuf::from(path));
        assert_eq!([boxes.boxes, boxes.groups, boxes.masks], [path("/b.json"), path("/g.json"), None]);
        let words = comparison("--prompt car. --models /n")??.config.pipeline;
        assert_eq!((words.prompt.as_deref(), words.models, words.boxes), (Some("car."), path("/n"), None));
        assert!(comparison("--boxes b.json --masks m").is_err());
        Ok(())
    }
}
