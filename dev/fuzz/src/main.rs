//! The program `instgs-fuzz`: see [`instgs_fuzz`].

use std::alloc::System;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use cap::Cap;
use clap::{Args, Parser, Subcommand};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer, exit_code, parse};
use instgs_fuzz::inputs::BATCH;
use instgs_fuzz::supervisor::{self, Limits};
use instgs_fuzz::{Target, targets, worker};

/// Counts what is allocated; a worker sets the limit.
#[global_allocator]
static ALLOCATOR: Cap<System> = Cap::new(System, usize::MAX);

/// Gives damaged files to every reader. The same seed gives the same inputs.
#[derive(Parser)]
#[command(name = "instgs-fuzz", version, max_term_width = 110, args_conflicts_with_subcommands = true)]
#[command(
    after_help = "Examples:\n  tools/fuzz\n  tools/fuzz ply 10\n  instgs-fuzz --read out/fuzz/ply-0a1b2c3d.bin ply"
)]
struct Cli {
    #[command(flatten)]
    fuzz: FuzzArgs,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Args)]
struct FuzzArgs {
    /// Readers, by name [default: all]
    targets: Vec<String>,
    /// Inputs for each reader [default: 10000, or without end if --minutes is given]
    #[arg(long, value_name = "N")]
    inputs: Option<u64>,
    /// Time for all readers together
    #[arg(long, value_name = "M")]
    minutes: Option<f64>,
    /// Other seeds give other inputs
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Longest time for one input, seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    seconds_per_input: f64,
    /// Most memory that a reader may allocate, MiB
    #[arg(long, value_name = "MIB", default_value_t = 512)]
    memory: u64,
    /// Folder for inputs that break a promise
    #[arg(long, value_name = "DIR", default_value = "out/fuzz")]
    out: PathBuf,
    /// List the readers
    #[arg(long)]
    list: bool,
    /// Give this file to the reader, and nothing else
    #[arg(long, value_name = "FILE")]
    read: Option<PathBuf>,
}

#[derive(Subcommand)]
enum Command {
    /// One process of a run
    #[command(hide = true)]
    Worker(WorkerArgs),
}

#[derive(Args)]
struct WorkerArgs {
    target: String,
    #[arg(long)]
    seed: u64,
    #[arg(long)]
    first: u64,
    #[arg(long)]
    end: u64,
    #[arg(long)]
    milliseconds_per_input: u64,
    #[arg(long)]
    milliseconds: Option<u64>,
    #[arg(long)]
    memory: u64,
    #[arg(long)]
    progress: PathBuf,
    #[arg(long)]
    result: PathBuf,
    #[arg(long)]
    scratch: PathBuf,
    #[arg(long)]
    keep: Option<PathBuf>,
}

fn main() -> ExitCode {
    let cli: Cli = match parse() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let printer = Printer::new(false);
    let result = match &cli.command {
        Some(Command::Worker(args)) => work(args, &printer),
        None => fuzz(&cli.fuzz, &printer),
    };
    exit_code(result, &printer)
}

fn known(name: &str) -> Result<Target, CliError> {
    targets::named(name).ok_or_else(|| CliError::msg(format!("there is no reader {name}; --list lists them")))
}

fn fuzz(args: &FuzzArgs, printer: &Printer) -> Result<(), CliError> {
    if args.list {
        targets::all().iter().for_each(|target| printer.line(target.name));
        return Ok(());
    }
    let chosen = match args.targets.is_empty() {
        true => targets::all(),
        false => args.targets.iter().map(|name| known(name)).collect::<Result<_, _>>()?,
    };
    if let Some(path) = &args.read {
        return read_one(&chosen, path, printer);
    }
    let inputs = args.inputs.or(args.minutes.is_none().then_some(10_000));
    let limits = Limits {
        seed: args.seed,
        batches: inputs.map_or(u64::MAX, |inputs| inputs.div_ceil(BATCH)),
        time: args.minutes.map(|minutes| seconds(60.0 * minutes / chosen.len() as f64)).transpose()?,
        time_per_input: seconds(args.seconds_per_input)?,
        memory_mib: args.memory,
    };
    let program = std::env::current_exe()?;
    let mut table = Table::default();
    table.row(["reader", "inputs", "accepted", "inputs/s", "slowest", "memory", "faults"].map(String::from));
    let mut faults = 0;
    for target in chosen {
        let outcome = supervisor::run(&program, target.name, &limits, &args.out)?;
        for fault in &outcome.faults {
            let saved = fault.input.as_ref().map(|path| format!("; saved as {}", path.display()));
            printer.warning(format_args!("{}: {}{}", target.name, fault.what, saved.unwrap_or_default()));
        }
        faults += outcome.faults.len();
        let done = &outcome.done;
        table.row([
            target.name.to_owned(),
            grouped(done.inputs),
            format!("{:.0} %", 100.0 * done.accepted as f64 / done.inputs.max(1) as f64),
            grouped((done.inputs as f64 / outcome.seconds.max(1e-9)) as u64),
            format!("{:.0} ms", 1e3 * done.slowest_seconds),
            format!("{:.1} MiB", done.peak_bytes as f64 / f64::from(1 << 20)),
            outcome.faults.len().to_string(),
        ]);
    }
    printer.line(table);
    match faults {
        0 => Ok(()),
        _ => Err(CliError::msg(format!("{faults} inputs broke a promise; give each to its reader with --read FILE"))),
    }
}

fn seconds(seconds: f64) -> Result<Duration, CliError> {
    Ok(Duration::try_from_secs_f64(seconds)?)
}

/// Gives one file to each of the readers.
fn read_one(chosen: &[Target], path: &std::path::Path, printer: &Printer) -> Result<(), CliError> {
    let bytes = instgs_io::read_bytes(path)?;
    let scratch = tempfile::tempdir()?;
    for target in chosen {
        let accepted = (target.read)(&bytes, scratch.path());
        printer.line(format_args!("{}: {}", target.name, if accepted { "read" } else { "refused" }));
    }
    Ok(())
}

fn work(args: &WorkerArgs, printer: &Printer) -> Result<(), CliError> {
    let target = known(&args.target)?;
    let limited = ALLOCATOR.set_limit((args.memory as usize) << 20);
    limited.map_err(|()| CliError::msg("more memory is allocated than --memory allows"))?;
    let job = worker::Job {
        seed: args.seed,
        batches: args.first..args.end,
        time: args.milliseconds.map(Duration::from_millis),
        time_per_input: Duration::from_millis(args.milliseconds_per_input),
        progress: args.progress.clone(),
        keep: args.keep.clone(),
        scratch: args.scratch.clone(),
    };
    let done = worker::run(target, &job, &|| ALLOCATOR.max_allocated() as u64).map_err(CliError::from_boxed)?;
    printer.json_file(&args.result, &done)
}
