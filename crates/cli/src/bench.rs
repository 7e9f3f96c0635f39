//! `instgs-vk bench`: the flags of the measurement, and its report as a table. [`instgs_eval::bench`] measures.

use std::cell::Cell;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::Args;

use super::bench_report::print_report;
use super::followed::Followed;
use instgs_console::args::{
    HostMemoryArgs, JsonArgs, LookArgs, MemoryArgs, PrecisionArgs, ViewArgs, open_scene_to_draw, parse_lod,
    parse_precision,
};
use instgs_console::device::{self, DeviceArgs};
use instgs_console::opened::{CoarserViews, OpenedScene};
use instgs_console::{CliError, Printer};
use instgs_eval::Counts;
use instgs_eval::bench::{self, MeasurePhase, Report, Subject};
use instgs_io::LoadedScene;
use instgs_vk::gpu::Gpu;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::{DevicePrecision, InstancedScene};

/// Measures frame time and memory of a scene, alone or side by side with another one.
///
/// Frames are timed from recording to their end on the device, without read-back, after warm-up frames; with --against
/// the two scenes take turns frame by frame. Ratios above 1 mean that the scene is better than the other.
///
/// A scene with pages that memory is too short for is timed as `render` draws it: pages are read before a frame's time begins. A
/// warning, and coarser_views in JSON, say how many cameras see it coarser because its pages have no room. With --against and
/// --lod scenes are read as a whole.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk bench --scene garden.ply --camera cameras.json --frames 30\n  \
    instgs-vk bench --scene room.instgs --against room.ply --orbit 8 --size 640x360 --json report.json\n  \
    instgs-vk bench --scene room.instgs --against room.instgs --against-precision f32 --data room\n  \
    instgs-vk bench --scene room.instgs --data room --lod 1,2,4\n  \
    instgs-vk bench --scene city.instgs --camera flight.json --host-memory-mb 1000 --device-memory-mb 1000")]
pub(super) struct BenchArgs {
    /// Scene to measure: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(long, value_name = "S")]
    pub(super) scene: PathBuf,
    /// Scene to compare with, from the same cameras
    #[arg(long, value_name = "S2", conflicts_with = "host_memory_mb")]
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
    #[arg(
        long,
        value_name = "PX,..",
        value_delimiter = ',',
        value_parser = parse_lod,
        conflicts_with_all = ["against", "host_memory_mb"]
    )]
    pub(super) lod: Vec<f32>,
    #[command(flatten)]
    pub(super) look: LookArgs,
    #[command(flatten)]
    pub(super) memory: MemoryArgs,
    #[command(flatten)]
    host_memory: HostMemoryArgs,
    #[command(flatten)]
    pub(super) json: JsonArgs,
}

/// What `--json` writes.
#[derive(serde::Serialize)]
struct BenchOutput<'a> {
    #[serde(flatten)]
    report: &'a Report,
    /// Number of cameras whose pages had no room, so that they see the scene coarser than it is; left out if there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    coarser_views: Option<NonZeroUsize>,
}

pub(super) fn run(args: &BenchArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    args.json.create_folder()?;
    if !args.lod.is_empty() {
        let loaded = open_scene_to_draw(&args.scene, printer)?;
        return super::bench_lod::run(args, &loaded, device_args.choice(), printer);
    }
    let opened = match args.against {
        // Pages of two scenes would share the memory.
        Some(_) => OpenedScene::Whole(Box::new(open_scene_to_draw(&args.scene, printer)?)),
        None => OpenedScene::open_warned(&args.scene, args.host_memory.of_scenes(), printer)?,
    };
    let against = args.against.as_deref().map(|path| open_scene_to_draw(path, printer)).transpose()?;
    let cameras = args.views.cameras(&args.scene, opened.scene(), args.look.options(opened.scene()).near, printer)?;
    if cameras.len() > args.frames as usize {
        let (frames, count) = (args.frames, cameras.len());
        printer.warning(format_args!("{frames} frames are too few for {count} cameras: the first {frames} are timed"));
    }
    let gpu = device::open(device_args.choice())?;
    args.memory.limit(&gpu);
    let coarser = Cell::new(CoarserViews::default());
    let timed = cameras.len().min(args.frames as usize);
    let precision = args.precision.precision();
    let against_precision = args.against_precision.unwrap_or(precision);
    // What is measured borrows a scene in host memory; one in pages gives its file away.
    let loaded;
    let scene = match opened {
        OpenedScene::Whole(in_memory) => {
            loaded = in_memory;
            whole(args, &args.scene, &loaded, precision)
        }
        OpenedScene::InPages(_) => in_pages(args, opened, &gpu, &coarser, timed),
    };
    let against = args.against.as_deref().zip(against.as_ref());
    let against = against.map(|(path, loaded)| whole(args, path, loaded, against_precision));
    let mut progress = printer.progress("bench", args.frames.into());
    let mut on_event = |phase| {
        if phase == MeasurePhase::Timed {
            progress.step("");
        }
    };
    let report = bench::run::<CliError>(&gpu, scene, against, &cameras, args.frames, &mut on_event)?;
    drop(progress);
    device::check_validation(&gpu)?;
    if report.scene.passes_ms.is_empty() {
        printer.warning("this device has no timestamps: passes_ms is empty");
    }
    if let Some(what) = coarser.get().warning() {
        printer.warning(format_args!("{}: {what}", args.scene.display()));
    }
    let coarser_views = NonZeroUsize::new(coarser.get().count());
    if args.json.write(&BenchOutput { report: &report, coarser_views }, printer)? {
        print_report(&report, printer);
    }
    Ok(())
}

/// How a scene is drawn.
pub(super) fn options(args: &BenchArgs, scene: &InstancedScene, device_precision: DevicePrecision) -> RenderOptions {
    RenderOptions { device_precision, ..args.memory.apply(args.look.options(scene)) }
}

/// A scene that is in host memory as a whole.
fn whole<'a>(
    args: &BenchArgs,
    path: &Path,
    loaded: &'a LoadedScene,
    precision: DevicePrecision,
) -> Subject<'a, CliError> {
    let options = options(args, &loaded.scene, precision);
    Subject::whole(path.display().to_string(), &loaded.scene, loaded.file_bytes, options)
}

/// The scene of `--scene` whose background stays in its file. The first `timed` views it is made ready for count in `coarser`.
fn in_pages<'a>(
    args: &BenchArgs,
    opened: OpenedScene,
    gpu: &'a Gpu,
    coarser: &'a Cell<CoarserViews>,
    timed: usize,
) -> Subject<'a, CliError> {
    let place = args.scene.display().to_string();
    let (scene, [stored, expanded]) = (opened.scene(), opened.counts());
    let standing = Counts::of(scene);
    let background = stored - standing.template - standing.own;
    let counts = Counts { background, expanded, ..standing };
    Subject {
        name: place.clone(),
        counts,
        file_bytes: opened.file_bytes(),
        host_bytes: scene.tensor_bytes(),
        options: options(args, scene, args.precision.precision()),
        upload: Box::new(move |renderer, options| {
            let scene = opened.upload(gpu, renderer, options);
            let scene = scene.map_err(|error| CliError::msg(format!("{place}: {error}")))?;
            Ok(Box::new(Followed { scene, place, left_to_count: timed, counted: coarser }))
        }),
    }
}
