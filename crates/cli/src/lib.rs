//! L9: the command line. One file per subcommand; each parses its flags, calls the library and reports through the one
//! [`Printer`]. No subcommand calls another: what several need is in modules of its own, such as `training` (a run with its
//! progress and reports) and `comparison`. Exit codes: 0 done, 1 failed (one line `error: what, where, what to do` on stderr), 2 wrong usage.

mod args;
mod bench;
mod bench_lod;
mod bench_report;
mod compare;
mod comparison;
mod data_set;
pub mod demo;
mod device;
mod edit;
mod edit_flags;
mod error;
mod eval;
mod export;
mod find;
mod info;
mod inspect;
mod inspect_file;
mod inspect_groups;
mod lavapipe;
mod lpips_args;
mod mask_args;
mod masks;
mod picture_files;
mod picture_grid;
#[cfg(feature = "player")]
mod player;
mod printer;
mod progress_lines;
mod render;
mod stages;
mod synth;
mod table;
mod tables;
mod train;
mod training;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

pub use error::CliError;
pub use lavapipe::choose_lavapipe_width;
#[cfg(feature = "player")]
pub use player::player_main;
pub use printer::Printer;

/// Shared-template Gaussian instancing on raw Vulkan: small, fast, editable 3D Gaussian scenes.
#[derive(Parser)]
#[command(name = "instgs-vk", version, arg_required_else_help = true, max_term_width = 110)]
struct Cli {
    #[command(flatten)]
    device: device::DeviceArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Info(info::InfoArgs),
    Demo(demo::DemoArgs),
    Render(render::RenderArgs),
    Eval(eval::EvalArgs),
    Bench(bench::BenchArgs),
    Inspect(inspect::InspectArgs),
    Export(export::ExportArgs),
    Edit(edit::EditArgs),
    Synth(synth::SynthArgs),
    Train(train::TrainArgs),
    Compare(compare::CompareArgs),
    Tables(tables::TablesArgs),
    Masks(masks::MasksArgs),
    Segment(stages::segment::SegmentArgs),
    Register(stages::register::RegisterArgs),
    Merge(stages::merge::MergeArgs),
    Find(find::FindArgs),
}

const SUCCESS: u8 = 0;
const FAILURE: u8 = 1;
const USAGE: u8 = 2;

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help goes to stdout and is no failure. A closed stream is nobody's to tell.
            let _ = error.print();
            return ExitCode::from(if error.use_stderr() { USAGE } else { SUCCESS });
        }
    };
    let printer = Printer::new(cli.command.json_on_stdout());
    match run(&cli, &printer) {
        Ok(()) => ExitCode::from(SUCCESS),
        Err(error) => {
            printer.error(&error);
            ExitCode::from(FAILURE)
        }
    }
}

impl Command {
    /// True if stdout is for the JSON report alone.
    fn json_on_stdout(&self) -> bool {
        match self {
            Self::Info(args) => args.json,
            Self::Demo(args) => args.json,
            Self::Render(args) => args.json,
            Self::Eval(args) => args.json_on_stdout(),
            Self::Bench(args) => args.json_on_stdout(),
            Self::Inspect(args) => args.json,
            Self::Export(args) => args.json,
            Self::Edit(args) => args.json,
            Self::Synth(args) => args.json,
            Self::Train(args) => args.json,
            Self::Compare(args) => args.json,
            Self::Tables(args) => args.json,
            Self::Masks(args) => args.json,
            Self::Segment(args) => args.json,
            Self::Register(args) => args.json,
            Self::Merge(args) => args.json,
            Self::Find(args) => args.json,
        }
    }
}

fn run(cli: &Cli, printer: &Printer) -> Result<(), CliError> {
    match &cli.command {
        Command::Info(args) => info::run(args, &cli.device, printer),
        Command::Demo(args) => demo::run_command(args, &cli.device, printer),
        Command::Render(args) => render::run(args, &cli.device, printer),
        Command::Eval(args) => eval::run(args, &cli.device, printer),
        Command::Bench(args) => bench::run(args, &cli.device, printer),
        Command::Inspect(args) => inspect::run(args, printer),
        Command::Export(args) => export::run(args, printer),
        Command::Edit(args) => edit::run(args, printer),
        Command::Synth(args) => synth::run(args, printer),
        Command::Train(args) => train::run(args, &cli.device, printer),
        Command::Compare(args) => compare::run(args, &cli.device, printer),
        Command::Tables(args) => tables::run(args, &cli.device, printer),
        Command::Masks(args) => masks::run(args, &cli.device, printer),
        Command::Segment(args) => stages::segment::run(args, &cli.device, printer),
        Command::Register(args) => stages::register::run(args, &cli.device, printer),
        Command::Merge(args) => stages::merge::run(args, printer),
        Command::Find(args) => find::run(args, printer),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_argument_definitions_are_consistent() {
        Cli::command().debug_assert();
    }
}
