//! Evidence for the claims about the product: ray-traced data sets with known truth (`synth`), comparisons of instanced
//! and plain scenes of the same training time and the same bytes (`compare`; the protocol is in docs/design.md), the
//! same for a list of scenes with rivals, ablations and plots (`tables`), and all of it on eight cars (`demo`).
//!
//! Not published: `instgs-evidence` is built next to `instgs-vk`, which passes these subcommands on to it.

mod compare;
mod comparison;
mod data_set;
mod demo;
mod gains;
pub mod origin;
mod picture_grid;
pub mod protocol;
pub mod results;
mod synth;
mod tables;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use instgs_console::{CliError, Printer, device, exit_code, parse};

/// Evidence about instgs-vk: data sets with known truth, comparisons, tables.
#[derive(Parser)]
// Users call it through instgs-vk, so its help shows that name.
#[command(name = "instgs-vk", version, arg_required_else_help = true, max_term_width = 110)]
struct Cli {
    #[command(flatten)]
    device: device::DeviceArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::DemoArgs),
    Synth(synth::SynthArgs),
    Compare(compare::CompareArgs),
    Tables(tables::TablesArgs),
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    let cli: Cli = match parse() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let json_on_stdout = match &cli.command {
        Command::Demo(args) => args.json,
        Command::Synth(args) => args.json,
        Command::Compare(args) => args.json,
        Command::Tables(args) => args.json,
    };
    let printer = Printer::new(json_on_stdout);
    exit_code(run(&cli, &printer), &printer)
}

fn run(cli: &Cli, printer: &Printer) -> Result<(), CliError> {
    match &cli.command {
        Command::Demo(args) => demo::run_command(args, &cli.device, printer),
        Command::Synth(args) => synth::run(args, printer),
        Command::Compare(args) => compare::run(args, &cli.device, printer),
        Command::Tables(args) => tables::run(args, &cli.device, printer),
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
