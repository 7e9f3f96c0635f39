//! The program `instgs-vk`. There is one file per subcommand, which parses its flags, calls the libraries and reports
//! through the one [`Printer`]. No subcommand calls another; code shared by several has modules of its own, such as
//! [`training`] (a run with its progress and reports). `demo`, `synth`, `compare` and `tables` belong to the program
//! `instgs-evidence`, which this one calls.

mod bench;
mod bench_lod;
pub mod bench_report;
mod config;
mod dry_run;
mod edit;
mod edit_flags;
mod eval;
mod evidence;
mod export;
mod export_page;
mod find;
mod followed;
mod info;
mod inspect;
mod inspect_file;
mod inspect_groups;
mod join;
mod levels;
pub mod lpips_args;
pub mod mask_args;
mod masks;
mod picture_files;
mod programs;
pub mod progress_lines;
mod prune;
mod render;
mod run_name;
mod shell_files;
mod split;
mod stages;
mod train;
pub mod training;
mod view;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use instgs_console::{CliError, Printer, SUCCESS, device, exit_code, parse};

/// Shared-template Gaussian instancing on raw Vulkan: small, fast, editable 3D Gaussian scenes.
#[derive(Parser)]
#[command(
    name = "instgs-vk",
    version,
    arg_required_else_help = true,
    max_term_width = 110,
    after_help = evidence::help()
)]
struct Cli {
    #[command(flatten)]
    device: device::DeviceArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Info(info::InfoArgs),
    Render(render::RenderArgs),
    Eval(eval::EvalArgs),
    Bench(bench::BenchArgs),
    Inspect(inspect::InspectArgs),
    Export(export::ExportArgs),
    Edit(edit::EditArgs),
    Prune(prune::PruneArgs),
    Levels(levels::LevelsArgs),
    Train(train::TrainArgs),
    Masks(masks::MasksArgs),
    Segment(stages::segment::SegmentArgs),
    Register(stages::register::RegisterArgs),
    Merge(stages::merge::MergeArgs),
    Find(find::FindArgs),
    Split(split::SplitArgs),
    Join(join::JoinArgs),
    View(view::ViewArgs),
    Config(config::ConfigArgs),
    Completions(shell_files::CompletionsArgs),
    Man(shell_files::ManArgs),
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    if let Some(result) = evidence::run_if_asked(std::env::args_os().skip(1)) {
        return result.unwrap_or_else(|error| exit_code(Err(error), &Printer::new(false)));
    }
    let cli: Cli = match parse() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let printer = Printer::new(cli.command.json_on_stdout());
    run(&cli, &printer).unwrap_or_else(|error| exit_code(Err(error), &printer))
}

impl Command {
    /// True if stdout carries only the JSON report.
    fn json_on_stdout(&self) -> bool {
        match self {
            Self::Info(args) => args.json,
            Self::Render(args) => args.json,
            Self::Eval(args) => args.json.on_stdout(),
            Self::Bench(args) => args.json.on_stdout(),
            Self::Inspect(args) => args.json,
            Self::Export(args) => args.json,
            Self::Edit(args) => args.json,
            Self::Prune(args) => args.json,
            Self::Levels(args) => args.json,
            Self::Train(args) => args.json,
            Self::Masks(args) => args.json,
            Self::Segment(args) => args.json,
            Self::Register(args) => args.json,
            Self::Merge(args) => args.json,
            Self::Find(args) => args.json,
            Self::Split(args) => args.json,
            Self::Join(args) => args.json,
            Self::Config(args) => args.json_on_stdout(),
            Self::View(_) | Self::Completions(_) | Self::Man(_) => false,
        }
    }
}

fn run(cli: &Cli, printer: &Printer) -> Result<ExitCode, CliError> {
    let done = match &cli.command {
        Command::Info(args) => info::run(args, &cli.device, printer),
        Command::Render(args) => render::run(args, &cli.device, printer),
        Command::Eval(args) => eval::run(args, &cli.device, printer),
        Command::Bench(args) => bench::run(args, &cli.device, printer),
        Command::Inspect(args) => inspect::run(args, printer),
        Command::Export(args) => export::run(args, &cli.device, printer),
        Command::Edit(args) => edit::run(args, printer),
        Command::Prune(args) => prune::run(args, &cli.device, printer),
        Command::Levels(args) => levels::run(args, &cli.device, printer),
        Command::Train(args) => train::run(args, &cli.device, printer),
        Command::Masks(args) => masks::run(args, &cli.device, printer),
        Command::Segment(args) => stages::segment::run(args, &cli.device, printer),
        Command::Register(args) => stages::register::run(args, &cli.device, printer),
        Command::Merge(args) => stages::merge::run(args, printer),
        Command::Find(args) => find::run(args, printer),
        Command::Split(args) => split::run(args, printer),
        Command::Join(args) => join::run(args, &cli.device, printer),
        // The only one with an exit code of its own: the player's.
        Command::View(args) => return view::run(args, &cli.device),
        Command::Config(args) => config::run(args, printer),
        Command::Completions(args) => shell_files::completions(args, Cli::command(), printer),
        Command::Man(args) => shell_files::man(args, Cli::command(), printer),
    };
    done.map(|()| ExitCode::from(SUCCESS))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_argument_definitions_are_consistent() {
        Cli::command().debug_assert();
    }
}
