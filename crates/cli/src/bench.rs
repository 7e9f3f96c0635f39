//! `instgs-vk bench`: the flags of the measurement, and its report as a table. [`instgs_eval::bench`] measures.

use std::path::{Path, PathBuf};

use clap::Args;

use super::bench_report::print_report;
use instgs_console::args::{
    JsonArgs, LookArgs, MemoryArgs, PrecisionArgs, ViewArgs, open_scene_to_draw, parse_lod, parse_precision,
};
use instgs_console::device::{self, DeviceArgs};
use instgs_console::{CliError, Printer};
use instgs_eval::bench::{self, MeasurePhase, Subject};
use instgs_io::LoadedScene;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::DevicePrecision;

/// Measures frame time and memory of a scene, alone or side by side with another one.
///
/// Frames are timed from recording to their end on the device, without read-back, after warm-up frames; with --against
/// the two scenes take turns frame by frame. Ratios above 1 mean that the scene is better than the other.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk bench --scene garden.ply --camera cameras.json --frames 30\n  \
    instgs-vk bench --scene room.instgs --against room.ply --orbit 8 --size 640x360 --json report.json\n  \
    instgs-vk bench --scene room.instgs --against room.instgs --against-precision f32 --data room\n  \
    instgs-vk bench --scene room.instgs --data room --lod 1,2,4")]
pub(super) struct BenchArgs {
    /// Scene to measure: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(long, value_name = "S")]
    pub(super) scene: PathBuf,
    /// Scene to compare with, from the same cameras
    #[arg(long, value_name = "S2")]
    against: Option<PathBuf>,
    #[command(flatten)]
    pub(super) precision: PrecisionArgs,
    /// The same for the scene to compare with [default: that of --device-precision]
    #[arg(long, value_name = "P", value_parser = parse_precision, requires = "against")]
    against_precision: Option<DevicePrecision>,
    #[command(flatten)]
    pub(super) views: ViewArgs,
    /// Timed frames of each scene, cycling through the cameras
    #[arg(long, value_name = "N", default_value = "30", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub(super) frames: u32,
    /// Also measures levels of detail at these errors: their cost compared with full quality and, with --data without
    /// --size, with the photos, and the time that they save
    #[arg(long, value_name = "PX,..", value_delimiter = ',', value_parser = parse_lod, conflicts_with = "against")]
    pub(super) lod: Vec<f32>,
    #[command(flatten)]
    pub(super) look: LookArgs,
    #[command(flatten)]
    pub(super) memory: MemoryArgs,
    #[command(flatten)]
    pub(super) json: JsonArgs,
}

pub(super) fn run(args: &BenchArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let loaded = open_scene_to_draw(&args.scene, printer)?;
    if !args.lod.is_empty() {
        return super::bench_lod::run(args, &loaded, device_args.choice(), printer);
    }
    let loaded_against = args.against.as_deref().map(|path| open_scene_to_draw(path, printer)).transpose()?;
    let cameras = args.views.cameras(&loaded.scene, args.look.options(&loaded.scene).near, printer)?;
    if cameras.len() > args.frames as usize {
        let (frames, count) = (args.frames, cameras.len());
        printer.warning(format_args!("{frames} frames are too few for {count} cameras: the first {frames} are timed"));
    }
    let gpu = device::open(device_args.choice())?;
    args.memory.limit(&gpu);
    let scene = subject(args, &args.scene, &loaded, args.precision.precision());
    let against = args.against.as_deref().zip(loaded_against.as_ref());
    let against_precision = args.against_precision.unwrap_or(args.precision.precision());
    let against = against.map(|(path, loaded)| subject(args, path, loaded, against_precision));
    let mut progress = printer.progress("bench", args.frames.into());
    let mut on_event = |phase| {
        if phase == MeasurePhase::Timed {
            progress.step("");
        }
    };
    let report = bench::run(&gpu, &scene, against.as_ref(), &cameras, args.frames, &mut on_event)?;
    drop(progress);
    device::check_validation(&gpu)?;
    if report.scene.passes_ms.is_empty() {
        printer.warning("this device has no timestamps: passes_ms is empty");
    }
    if args.json.write(&report, printer)? {
        print_report(&report, printer);
    }
    Ok(())
}

pub(super) fn subject<'a>(
    args: &BenchArgs,
    path: &Path,
    loaded: &'a LoadedScene,
    device_precision: DevicePrecision,
) -> Subject<'a> {
    Subject {
        name: path.display().to_string(),
        scene: &loaded.scene,
        file_bytes: loaded.file_bytes,
        options: RenderOptions { device_precision, ..args.memory.apply(args.look.options(&loaded.scene)) },
    }
}
