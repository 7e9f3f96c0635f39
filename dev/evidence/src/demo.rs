//! `instgs-vk demo`: all steps on a generated data set, from photos to a table and pictures side by side.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;
use serde::Serialize;

use super::comparison::{Comparison, Rival, compare};
use super::data_set::make_data;
use super::picture_grid::{DIFFERENCE_GAIN, Grid};
use crate::protocol::SeedResult;
use instgs_cli::training::Session;
use instgs_console::args::create_folder;
use instgs_console::device::{self, DeviceArgs};
use instgs_console::{CliError, Printer};
use instgs_io::RunFolder;
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_synth::dataset;
use instgs_train::interrupt::Interrupt;

/// Steps of the plain cloud and of the joint phase, and the largest number of Gaussians: less than ten minutes
/// including the build, on two CPU cores without AVX-512.
const QUICK: [&str; 3] = ["steps=400", "joint.steps=400", "max_gaussians=26000"];
/// Number of timed frames of each scene.
const FRAMES: u32 = 18;

/// Shows all steps on a generated car park: photos, 3DGS, templates and instances, a table and pictures side by side.
///
/// Renders a data set of eight racing cars (DIR/data), trains a plain cloud, finds the cars by their masks, registers
/// them to each other and makes them instances of one template, trains both on for the same time (DIR/compare), and
/// writes DIR/pictures.png: photo, 3DGS, InstGS, and the difference between InstGS and the photo. Steps that are done
/// are not repeated.
#[derive(Args)]
#[command(after_help = "Example:\n  instgs-vk demo --out out/demo")]
pub(super) struct DemoArgs {
    /// Folder for data, runs and pictures; created if necessary
    #[arg(long, value_name = "DIR", default_value = "out/demo")]
    out: PathBuf,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// The results of the demo.
#[derive(Debug, Serialize)]
pub(super) struct DemoReport {
    /// Folder of the data set.
    data: PathBuf,
    /// Results, one per seed.
    results: Vec<SeedResult>,
    /// Path of the photos and renderings side by side.
    pictures: PathBuf,
    /// Path of the instanced scene.
    scene: PathBuf,
    /// Wall time of all steps.
    seconds: f64,
}

pub(super) fn run_command(args: &DemoArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let started = Instant::now();
    let interrupt = Interrupt::on_ctrl_c()?;
    let gpu = device::open(device_args.choice())?;
    let session = Session { gpu: &gpu, interrupt: &interrupt, printer };
    create_folder(&args.out)?;
    let data = args.out.join("data");
    make_data("cars", &data, &dataset::Options::default(), printer)?;
    let comparison = Comparison {
        config: config()?,
        data: data.clone(),
        out: args.out.join("compare"),
        seeds: vec![0],
        frames: FRAMES,
        more_steps: None,
        rivals: vec![Rival::SameBytes],
        lpips: None,
    };
    let mut grid = Grid::default();
    let results = compare(&session, &comparison, &mut |name, view| grid.add(name, view))?.seeds;
    device::check_validation(&gpu)?;
    let report = DemoReport {
        pictures: args.out.join("pictures.png"),
        scene: RunFolder::new(comparison.out.join("seed_0/instgs")).scene(),
        data,
        results,
        seconds: started.elapsed().as_secs_f64(),
    };
    grid.write(&report.pictures)?;
    if args.json {
        return printer.json(&report);
    }
    printer.line("");
    printer.line(format_args!("photo, 3DGS, InstGS, difference x{DIFFERENCE_GAIN}: {}", report.pictures.display()));
    printer.line(format_args!("the instanced scene: {}; try instgs-vk edit on it", report.scene.display()));
    printer.line(format_args!("{:.0} s in all", report.seconds));
    Ok(())
}

fn config() -> Result<RunConfig, CliError> {
    let mut builder = ConfigBuilder::new().file("instgs_quick")?;
    for assignment in QUICK {
        builder = builder.set(assignment)?;
    }
    Ok(builder.finish()?)
}
