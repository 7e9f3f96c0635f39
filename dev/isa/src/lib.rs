//! What drivers of GPUs make of the kernels, on a machine without a GPU: registers, spills, occupancy, length of the code.
//!
//! Mesa's driver for AMD's GPUs compiles for a family that it is told (`families`), and says what came of it; limits on these
//! figures are in `configs/isa.toml` (`budgets`), and breaking one is an error. `instgs-isa here` does the same, without limits,
//! for the driver that the environment names. docs/gpu.md has the figures, and how to get those of other vendors.

pub mod budgets;
pub mod families;
pub mod figures;
pub mod table;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::{Args, Parser, Subcommand};
use instgs_console::device::DeviceArgs;
use instgs_console::{CliError, Printer, exit_code, parse};
use instgs_vk::gpu::{GpuOptions, PipelineCache};
use instgs_vk::kernels::{Variant, compile_every_pipeline, open_tuned};

use budgets::{Budgets, Verdict};
use families::{compile_for, find_driver};
use figures::DeviceFigures;

/// Compiles all kernels for GPUs that need not be there, and compares what drivers say of them with budgets.
#[derive(Parser)]
#[command(name = "instgs-isa", version, max_term_width = 110, args_conflicts_with_subcommands = true)]
#[command(after_help = "Example:\n  tools/isa\n  tools/isa --write-table docs/gpu.md")]
struct Cli {
    #[command(flatten)]
    gate: GateArgs,
    #[command(subcommand)]
    command: Option<Command>,
}

/// The gate: families of AMD's GPUs, by Mesa's driver.
#[derive(Args)]
struct GateArgs {
    /// Limits on figures, by kernel and family
    #[arg(long, value_name = "TOML", default_value = "configs/isa.toml")]
    budgets: PathBuf,
    /// Manifest of Mesa's driver for AMD's GPUs, instead of the system's radeon_icd.*.json
    #[arg(long, value_name = "JSON")]
    driver: Option<PathBuf>,
    /// Without the driver, say so and succeed
    #[arg(long)]
    allow_missing: bool,
    /// Also write the table of figures as Markdown; in a page that has a place for it, only that changes
    #[arg(long, value_name = "FILE")]
    write_table: Option<PathBuf>,
    /// Report as JSON on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Compiles all kernels on a Vulkan device of this machine and prints its driver's figures
    Here(HereArgs),
}

#[derive(Args)]
struct HereArgs {
    #[command(flatten)]
    device: DeviceArgs,
    /// Report as JSON on stdout
    #[arg(long)]
    json: bool,
}

#[derive(serde::Serialize)]
struct Report<'a> {
    families: &'a BTreeMap<String, DeviceFigures>,
    #[serde(flatten)]
    verdict: &'a Verdict,
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    let cli: Cli = match parse() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let json_on_stdout = match &cli.command {
        Some(Command::Here(args)) => args.json,
        None => cli.gate.json,
    };
    let printer = Printer::new(json_on_stdout);
    let result = match &cli.command {
        Some(Command::Here(args)) => run_here(args, &printer),
        None => run_gate(&cli.gate, &printer),
    };
    exit_code(result, &printer)
}

fn run_gate(args: &GateArgs, printer: &Printer) -> Result<(), CliError> {
    let budgets = Budgets::read(&args.budgets)?;
    let driver = match find_driver(args.driver.as_deref()) {
        Err(error) if args.allow_missing => {
            printer.warning(format_args!("NO KERNEL WAS COMPILED FOR GPUS: {error}"));
            return Ok(());
        }
        found => found?,
    };
    let families = compile_for(budgets.families.keys(), &driver)?;
    let verdict = budgets.judge(&families);
    if args.json {
        printer.json(&Report { families: &families, verdict: &verdict })?;
    }
    for (name, device) in &families {
        let DeviceFigures { subgroup_size, seconds, kernels, .. } = device;
        printer.line(format_args!("{name}: {} pipelines at {subgroup_size} lanes in {seconds:.1} s", kernels.len()));
    }
    for (kernel, known) in &budgets.known {
        let families: Vec<&str> = known.families.keys().map(String::as_str).collect();
        printer.line(format_args!("known: {kernel} on {}: {}", families.join(", "), known.why));
    }
    if let Some(path) = &args.write_table {
        table::write(path, &table::markdown(&families))?;
    }
    outcome(&verdict, &args.budgets.display().to_string(), printer)
}

/// Prints what is broken; an error if anything is.
fn outcome(verdict: &Verdict, budgets: &str, printer: &Printer) -> Result<(), CliError> {
    verdict.violations.iter().for_each(|violation| printer.warning(violation));
    verdict.mended.iter().for_each(|mended| printer.warning(mended));
    match verdict.violations.len() + verdict.mended.len() {
        0 => Ok(()),
        count => Err(CliError::msg(format!("{budgets}: {count} entries do not fit the kernels; see above"))),
    }
}

fn run_here(args: &HereArgs, printer: &Printer) -> Result<(), CliError> {
    let options = GpuOptions { device: args.device.choice(), pipeline_statistics: true, ..Default::default() };
    let gpu = open_tuned(options)?;
    // Devices that can only compile crash when they are closed (RADV 22.3.6), so the end of the process closes this one.
    std::mem::forget(gpu.clone());
    let (variant, begin) = (Variant::for_device(gpu.caps()), Instant::now());
    compile_every_pipeline(&gpu, &PipelineCache::new(&gpu, None)?, variant)?;
    let seconds = begin.elapsed().as_secs_f64();
    let figures = DeviceFigures::new(gpu.caps(), variant.subgroup_size, seconds, &gpu.compiled_pipelines()?);
    if args.json {
        return printer.json(&figures);
    }
    printer.line(table::markdown(&BTreeMap::from([(figures.device.clone(), figures)])).trim_end());
    Ok(())
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
