//! `instgs-player`: a window on a scene; or pictures without one.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::builder::PossibleValue;
use clap::{Parser, ValueEnum};

use crate::headless::{Timings, play};
use crate::script::{self, Step};
use crate::swapchain::PresentMode;
use crate::views::View;
use crate::window::{self, WindowJob};
use crate::{PlayerError, Stage, StageOptions};
use instgs_console::args::{LodArgs, LookArgs, Triple, parse_size, parse_up};
use instgs_console::device::{self, DeviceArgs};
use instgs_console::{CliError, Printer, exit_code, parse};
use instgs_io::json::as_map;
use instgs_io::{IoError, LoadedScene, load_scene, read_boxes, read_views};
use instgs_vk::math::statistics::{Percentiles, median};
use instgs_vk::render::FrameStats;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Camera, InstancedScene};

/// Shows a scene in a window: turn it, fly through it, look at depth and at what it costs. H lists the keys.
#[derive(Parser)]
#[command(
    name = "instgs-player",
    version,
    max_term_width = 110,
    after_help = "Examples:\n  \
    instgs-player room.instgs\n  \
    instgs-player room.instgs --data room          (Page Down steps through the data set's views)\n  \
    instgs-player room.instgs --headless --frames 120 --size 1920x1080 --screenshot last.png --json -\n\n\
Editing: click an object (Shift: more, G: all alike); M, T, X, N: arrows to move it, rings to turn it, a circle to\n\
scale it, none; Esc: puts back what is dragged; Ctrl+D, Delete, Ctrl+H: copy, remove, hide it; Ctrl+Shift+H: show all;\n\
Ctrl+Z, Ctrl+Y, Ctrl+S: take back, do again, save. The panel has numbers, colours, scattering, crop and eraser.\n\n\
Boxes: B, then click an object: a box goes around it; drag its dots until it fits; F: find all that look like it (O: of\n\
other sizes too); Shift+click: take a wrong one away; Ctrl+S: save boxes.json, for instgs-vk masks and train --boxes."
)]
struct PlayerArgs {
    /// Scene: .instgs, .ply, .spz or .splat; or drop one on the window
    #[arg(value_name = "S")]
    scene: PathBuf,
    /// Start at, and step through, the views of this data set
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Size of the window
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1280x720")]
    size: (u32, u32),
    /// Draw so many pictures without a pause and end: the views of --data in turn, else a circle around the scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    frames: Option<u64>,
    /// Where the last picture goes, as PNG, without what is written over it
    #[arg(long, value_name = "PNG")]
    screenshot: Option<PathBuf>,
    /// Draw without a window; also done where there is no display and --frames is given
    #[arg(long, requires = "frames")]
    headless: bool,
    /// Report on --frames as JSON, to a file or - for stdout
    #[arg(long, value_name = "F", requires = "frames")]
    json: Option<PathBuf>,
    /// Draw fewer pixels while things move if a picture takes the device longer than this; what stands still has all
    #[arg(long, value_name = "MS", value_parser = parse_budget, conflicts_with = "headless")]
    budget_ms: Option<f64>,
    /// Play what a person does from a text file, one line a picture (see src/player/script.rs)
    #[arg(long, value_name = "F", conflicts_with = "headless")]
    script: Option<PathBuf>,
    /// Boxes around objects: opens with the tool that draws and finds them (key B)
    #[arg(long, value_name = "F", conflicts_with = "headless")]
    boxes: Option<PathBuf>,
    /// When a picture replaces the one on the screen: with its refresh in order, with its refresh the newest, at once
    #[arg(long, value_enum, default_value = "fifo")]
    present: PresentArg,
    /// What is shown
    #[arg(long, value_enum, default_value = "color")]
    show: View,
    /// What --show tile-load (pairs a tile, 512 unless given) and offsets (part of the template's radius, 0.2) show palest; the
    /// least alpha of ellipses (0.3)
    #[arg(long, value_name = "X", value_parser = parse_level)]
    level: Option<f32>,
    /// Vertical of the scene [default: across a scene that is a plate, as -y, +z or +x; else -y]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    up: Option<Triple>,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    lod: LodArgs,
    #[command(flatten)]
    device: DeviceArgs,
}

#[derive(Clone, Copy, ValueEnum)]
enum PresentArg {
    Fifo,
    Mailbox,
    Immediate,
}

impl ValueEnum for View {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(match self {
            Self::Color => "color",
            Self::Alpha => "alpha",
            Self::Depth => "depth",
            Self::Instances => "instances",
            Self::Templates => "templates",
            Self::TileLoad => "tile-load",
            Self::Offsets => "offsets",
            Self::Points => "points",
            Self::Ellipses => "ellipses",
        }))
    }
}

fn parse_level(text: &str) -> Result<f32, String> {
    let level = text.parse::<f32>().ok().filter(|level| level.is_finite() && *level > 0.0);
    level.ok_or_else(|| "a number above 0 is wanted".into())
}

fn parse_budget(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|ms| (0.1..=1e6).contains(ms))
        .ok_or_else(|| "not a number of milliseconds from 0.1".into())
}

/// The steps of a script file; none without one.
fn script(path: Option<&Path>) -> Result<VecDeque<Step>, CliError> {
    let Some(path) = path else { return Ok(VecDeque::new()) };
    let text = std::fs::read_to_string(path).map_err(|e| IoError::new(path, e.to_string()))?;
    script::parse(&text, path.parent().unwrap_or(Path::new(""))).map_err(|e| IoError::new(path, e).into())
}

#[derive(serde::Serialize)]
struct Played {
    scene: String,
    device: String,
    /// Of the pictures.
    resolution: [u32; 2],
    window: bool,
    frames: u64,
    ms: Percentiles,
    fps: f64,
    /// Medians over the pictures.
    #[serde(serialize_with = "as_map")]
    passes_ms: Vec<(&'static str, f64)>,
    /// Medians; the interface is that of a window.
    present_ms: Option<f64>,
    ui_ms: Option<f64>,
    gaussians: PlayedGaussians,
}

#[derive(serde::Serialize)]
struct PlayedGaussians {
    stored: u64,
    expanded: u64,
    /// Mean.
    visible: u64,
    /// Mean.
    intersections: u64,
}

/// Runs the player with the process's arguments.
pub fn main() -> ExitCode {
    let args: PlayerArgs = match parse() {
        Ok(args) => args,
        Err(code) => return code,
    };
    let printer = Printer::new(args.json.as_ref().is_some_and(|path| path.as_os_str() == "-"));
    exit_code(run(&args, &printer), &printer)
}

fn run(args: &PlayerArgs, printer: &Printer) -> Result<(), CliError> {
    let loaded = load_scene(&args.scene);
    if let Err(error) = &loaded {
        // A window can say it; a batch cannot.
        if args.frames.is_some() {
            return Err(CliError::msg(error.to_string()));
        }
        printer.warning(error);
    }
    let cameras = match &args.data {
        Some(folder) => read_views(folder)?.views.into_iter().map(|view| view.camera).collect(),
        None => Vec::new(),
    };
    if args.headless {
        return headless(args, loaded?, &cameras, printer);
    }
    let boxes = args.boxes.as_ref().map(|path| read_boxes(path).map(|boxes| (path.clone(), boxes))).transpose()?;
    let script = script(args.script.as_deref())?;
    let counts = loaded.as_ref().map_or([0; 2], |loaded| gaussian_counts(&loaded.scene));
    let job = WindowJob { script, boxes, ..window_job(args, loaded, &cameras)? };
    match window::run(job) {
        Err(PlayerError::Window(reason)) if args.frames.is_some() => {
            printer.warning(format_args!("{reason}; drawing without a window"));
            headless(args, load_scene(&args.scene)?, &cameras, printer)
        }
        Err(error) => Err(error.into()),
        Ok(report) => {
            if let Some(message) = report.validation_message {
                return Err(CliError::msg(format!("validation layers: {message}")));
            }
            if args.frames.is_none() {
                return Ok(());
            }
            let played = played(args, counts, (report.device, report.size_px, true), &report.timings);
            print(args, &played, printer)
        }
    }
}

fn stage_options(args: &PlayerArgs, scene: &InstancedScene) -> Result<StageOptions, CliError> {
    let distance = Orbit::around(scene, args.up.map(Triple::direction)).distance;
    let view = args.show;
    let show = match args.level {
        None => Some(view.show(distance)),
        Some(level) => view.show_at(distance, level),
    };
    let words = "--level is for --show tile-load, offsets and ellipses";
    let show = show.ok_or_else(|| CliError::msg(words))?;
    Ok(StageOptions { render: args.lod.apply(args.look.options(scene)), show })
}

/// The cameras of `--frames`.
fn path_cameras(args: &PlayerArgs, scene: &InstancedScene, cameras: &[Camera]) -> Vec<Camera> {
    let frames = args.frames.unwrap_or(0);
    if cameras.is_empty() {
        return Orbit::around(scene, args.up.map(Triple::direction)).cameras(frames.min(100_000) as u32, args.size);
    }
    cameras.iter().map(|camera| camera.resized(args.size.0, args.size.1)).collect()
}

fn window_job(
    args: &PlayerArgs,
    loaded: Result<LoadedScene, IoError>,
    cameras: &[Camera],
) -> Result<WindowJob, CliError> {
    let empty = InstancedScene::default();
    let scene = loaded.as_ref().map_or(&empty, |loaded| &loaded.scene);
    let (options, path_cameras) = (stage_options(args, scene)?, path_cameras(args, scene, cameras));
    Ok(WindowJob {
        path: args.scene.clone(),
        scene: loaded.map(|loaded| (loaded.scene, loaded.file_bytes)).map_err(|error| error.to_string()),
        options,
        antialias: args.look.antialias(),
        cameras: cameras.to_vec(),
        up: args.up.map(Triple::direction),
        size_px: args.size,
        mode: match args.present {
            PresentArg::Fifo => PresentMode::Fifo,
            PresentArg::Mailbox => PresentMode::Mailbox,
            PresentArg::Immediate => PresentMode::Immediate,
        },
        device: args.device.choice(),
        validation: device::validation(),
        frames: args.frames,
        path_cameras,
        screenshot: args.screenshot.clone(),
        script: VecDeque::new(),
        budget_ms: args.budget_ms,
        boxes: None,
    })
}

fn headless(args: &PlayerArgs, loaded: LoadedScene, cameras: &[Camera], printer: &Printer) -> Result<(), CliError> {
    let options = stage_options(args, &loaded.scene)?;
    let gpu = device::open(args.device.choice())?;
    let mut stage = Stage::new(&gpu, loaded.scene, options)?;
    let path_cameras = path_cameras(args, stage.scene(), cameras);
    let timings = play(&mut stage, &path_cameras, args.frames.unwrap_or(1))?;
    if let Some(path) = &args.screenshot {
        stage.screenshot(path)?;
    }
    device::check_validation(&gpu)?;
    let size = stage.size_px().unwrap_or_default();
    print(
        args,
        &played(args, gaussian_counts(stage.scene()), (gpu.caps().name.clone(), size, false), &timings),
        printer,
    )
}

/// Stored and expanded.
fn gaussian_counts(scene: &InstancedScene) -> [u64; 2] {
    [(scene.templates.len() + scene.background.len()) as u64, scene.expanded_len()]
}

fn played(
    args: &PlayerArgs,
    [stored, expanded]: [u64; 2],
    (device, resolution, window): (String, [u32; 2], bool),
    timings: &Timings,
) -> Played {
    let ms = Percentiles::of(&timings.ms);
    let pictures = (timings.stats.len() as u64).max(1);
    let mean = |of: fn(&FrameStats) -> u64| timings.stats.iter().map(of).sum::<u64>() / pictures;
    let known_median = |ms: &[f64]| (!ms.is_empty()).then(|| median(ms));
    Played {
        scene: args.scene.display().to_string(),
        device,
        resolution,
        window,
        frames: timings.ms.len() as u64,
        fps: 1e3 / ms.median.max(1e-9),
        ms,
        passes_ms: FrameStats::median_ms_by_pass(&timings.stats),
        present_ms: known_median(&timings.present_ms),
        ui_ms: known_median(&timings.ui_ms),
        gaussians: PlayedGaussians {
            stored,
            expanded,
            visible: mean(|s| s.visible),
            intersections: mean(|s| s.intersections),
        },
    }
}

fn print(args: &PlayerArgs, played: &Played, printer: &Printer) -> Result<(), CliError> {
    match &args.json {
        Some(path) if path.as_os_str() == "-" => return printer.json(played),
        Some(path) => printer.json_file(path, played)?,
        None => {}
    }
    let [width, height] = played.resolution;
    let how = if played.window { "in a window" } else { "without a window" };
    printer.line(format_args!(
        "{}: {} pictures of {width}x{height} {how}, {:.1} FPS ({:.2} ms)",
        played.device, played.frames, played.fps, played.ms.median
    ));
    if let Some(path) = &args.screenshot {
        printer.line(path.display());
    }
    Ok(())
}
