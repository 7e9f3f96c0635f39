//! The program `instgs-player`: a window on a scene, or frames without a window.

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
use crate::{PlayerError, SceneViewer, ViewerOptions};
use instgs_console::args::{
    HostMemoryArgs, LodArgs, LookArgs, MemoryArgs, PrecisionArgs, Triple, orbit_of, parse_size, parse_up,
};
use instgs_console::device::{self, DeviceArgs};
use instgs_console::opened::OpenedScene;
use instgs_console::table::grouped;
use instgs_console::{CliError, Printer, exit_code, parse};
use instgs_io::json::as_map;
use instgs_io::{IoError, Place, read_boxes, read_views};
use instgs_vk::math::statistics::{Percentiles, median};
use instgs_vk::render::FrameStats;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Camera, InstancedScene};

/// Shows a scene in a window: orbit or fly through it, edit it, view depth, instances and rendering cost. F1 lists the
/// keys.
#[derive(Parser)]
#[command(
    name = "instgs-player",
    version,
    max_term_width = 110,
    after_help = "Examples:\n  \
    instgs-player room.instgs\n  \
    instgs-player room.instgs --data room          (Page Down steps through the data set's views)\n  \
    instgs-player room.instgs --headless --frames 120 --size 1920x1080 --screenshot last.png --json -\n\n\
Editing: click an object to select it (Shift: add, G: all of the same template); M, T, X, N: handles to move, rotate or\n\
scale it, no handles; Esc: cancel the drag; Ctrl+D, Delete, Ctrl+H: duplicate, delete, hide it; Ctrl+Shift+H: show all;\n\
Ctrl+Z, Ctrl+Y, Ctrl+S: undo, redo, save. The panel has numbers, colours, scattering, crop and eraser.\n\n\
Boxes: B, then click an object to draw a box around it; drag its dots until it fits; F: find all objects like it (O: in\n\
other sizes too); Shift+click: remove a wrong one; Ctrl+S: save SCENE.boxes.json, for instgs-vk masks and\n\
train --boxes."
)]
struct PlayerArgs {
    /// Scene file: .instgs, .ply, .spz, .sog, .splat or .glb; another can be dropped on the window
    #[arg(value_name = "S")]
    scene: PathBuf,
    /// Data set whose views give the first camera and can be stepped through
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Width and height of the window in pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size, default_value = "1280x720")]
    size: (u32, u32),
    /// Draw N frames without a pause and exit: through the views of --data, or on a circle around the scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    frames: Option<u64>,
    /// Save the last frame as PNG, without the overlay
    #[arg(long, value_name = "PNG")]
    screenshot: Option<PathBuf>,
    /// Draw without a window; the default where there is no display and --frames is given
    #[arg(long, requires = "frames")]
    headless: bool,
    /// Write a report on --frames as JSON to a file, or - for stdout
    #[arg(long, value_name = "F", requires = "frames")]
    json: Option<PathBuf>,
    /// Lower the resolution while the view changes if a frame takes the device longer than this; still views are always
    /// sharp
    #[arg(long, value_name = "MS", value_parser = parse_budget, conflicts_with = "headless")]
    budget_ms: Option<f64>,
    /// Play back user input from a text file, one line per frame
    #[arg(long, value_name = "F", conflicts_with = "headless")]
    script: Option<PathBuf>,
    /// File of boxes around objects: opens with the tool that draws and finds them (key B)
    #[arg(long, value_name = "F", conflicts_with = "headless")]
    boxes: Option<PathBuf>,
    /// Presentation mode: fifo (vsync), mailbox (vsync, newest frame), immediate (no vsync, may tear)
    #[arg(long, value_enum, default_value = "fifo")]
    present: PresentArg,
    /// The view to start with: colours, depth, instances ...
    #[arg(long, value_enum, default_value = "color")]
    show: View,
    /// Top of the colour scale for --show tile-load (intersections per tile, default 512) and offsets (fraction of the
    /// template's radius, default 0.2); smallest alpha of ellipses (default 0.3)
    #[arg(long, value_name = "X", value_parser = parse_level)]
    level: Option<f32>,
    /// Up axis of the scene [default: that of the training cameras, if the scene lies in the folder of its run; else, for a
    /// flat scene, the one of -y, +z, +x nearest to its normal; else -y]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    up: Option<Triple>,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    lod: LodArgs,
    #[command(flatten)]
    precision: PrecisionArgs,
    #[command(flatten)]
    memory: MemoryArgs,
    #[command(flatten)]
    host_memory: HostMemoryArgs,
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
    level.ok_or_else(|| "not a number above 0".into())
}

fn parse_budget(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|ms| (0.1..=1e6).contains(ms))
        .ok_or_else(|| "not a number of milliseconds of at least 0.1".into())
}

/// The steps of a script file; empty without a file.
fn script(path: Option<&Path>) -> Result<VecDeque<Step>, CliError> {
    let Some(path) = path else { return Ok(VecDeque::new()) };
    let text = std::fs::read_to_string(path).map_err(|e| IoError::new(path, e.to_string()))?;
    script::parse(&text, path.parent().unwrap_or(Path::new("")))
        .map_err(|e| IoError::new(path, e.reason.to_string()).at(Place::Line(e.line)).into())
}

#[derive(serde::Serialize)]
struct Played {
    scene: String,
    device: String,
    /// Width and height of the frames, pixels.
    resolution: [u32; 2],
    window: bool,
    frames: u64,
    ms: Percentiles,
    fps: f64,
    /// Median device time of each pass, milliseconds.
    #[serde(serialize_with = "as_map")]
    passes_ms: Vec<(&'static str, f64)>,
    /// Median device times, milliseconds; the interface is drawn in a window only.
    present_ms: Option<f64>,
    ui_ms: Option<f64>,
    gaussians: PlayedGaussians,
    /// Bytes of the scene that are in host memory, where kernels read what is in view.
    #[serde(skip_serializing_if = "is_zero")]
    scene_on_host_bytes: u64,
}

fn is_zero(bytes: &u64) -> bool {
    *bytes == 0
}

/// What frames were drawn of and on.
struct Drawn {
    /// Name of the Vulkan device.
    device: String,
    /// Number of stored and of expanded Gaussians.
    counts: [u64; 2],
    /// Bytes of the scene that are in host memory.
    scene_on_host_bytes: u64,
    /// Width and height of the frames, pixels.
    size_px: [u32; 2],
    window: bool,
}

#[derive(serde::Serialize)]
struct PlayedGaussians {
    stored: u64,
    expanded: u64,
    /// Mean number of visible splats.
    visible: u64,
    /// Mean number of intersections.
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
    let cameras = match &args.data {
        Some(folder) => read_views(folder)?.views.into_iter().map(|view| view.camera).collect(),
        None => Vec::new(),
    };
    if args.headless {
        return headless(args, &cameras, printer);
    }
    // Frames that are timed begin with the scene; a window reads it beside its first frames and displays errors.
    let open = |_| OpenedScene::open_warned(&args.scene, args.host_memory.of_scenes(), printer);
    let opened = args.frames.map(open).transpose()?;
    let counts = opened.as_ref().map_or([0; 2], OpenedScene::counts);
    let boxes = args.boxes.as_ref().map(|path| read_boxes(path).map(|boxes| (path.clone(), boxes))).transpose()?;
    let script = script(args.script.as_deref())?;
    let job = WindowJob { script, boxes, ..window_job(args, opened, &cameras)? };
    match window::run(job) {
        Err(PlayerError::Window(reason)) if args.frames.is_some() => {
            printer.warning(format_args!("{reason}; drawing without a window"));
            headless(args, &cameras, printer)
        }
        Err(error) => Err(error.into()),
        Ok(report) => {
            if let Some(message) = report.validation_message {
                return Err(CliError::msg(format!("validation layers: {message}")));
            }
            if args.frames.is_none() {
                return Ok(());
            }
            let drawn = Drawn {
                device: report.device,
                counts,
                scene_on_host_bytes: report.scene_on_host_bytes,
                size_px: report.size_px,
                window: true,
            };
            print(args, &played(args, drawn, &report.timings), printer)
        }
    }
}

fn viewer_options(args: &PlayerArgs, scene: &InstancedScene) -> Result<ViewerOptions, CliError> {
    // It is the same whatever is up.
    let distance = Orbit::around(scene, None).distance;
    let view = args.show;
    let show = match args.level {
        None => Some(view.show(distance)),
        Some(level) => view.show_at(distance, level),
    };
    let words = "--level needs --show tile-load, offsets or ellipses";
    let show = show.ok_or_else(|| CliError::msg(words))?;
    let render = args.memory.apply(args.precision.apply(args.lod.apply(args.look.options(scene))));
    Ok(ViewerOptions { render, show })
}

/// The cameras of the frames of `--frames`.
fn path_cameras(args: &PlayerArgs, scene: &InstancedScene, cameras: &[Camera]) -> Vec<Camera> {
    let frames = args.frames.unwrap_or(0);
    if cameras.is_empty() {
        // A window flies by itself.
        if frames == 0 {
            return Vec::new();
        }
        return orbit_of(&args.scene, scene, args.up).cameras(frames.min(100_000) as u32, args.size);
    }
    cameras.iter().map(|camera| camera.in_shape(args.size.into())).collect()
}

fn window_job(args: &PlayerArgs, opened: Option<OpenedScene>, cameras: &[Camera]) -> Result<WindowJob, CliError> {
    let empty = InstancedScene::default();
    let scene = opened.as_ref().map_or(&empty, OpenedScene::scene);
    let (options, path_cameras) = (viewer_options(args, scene)?, path_cameras(args, scene, cameras));
    Ok(WindowJob {
        path: args.scene.clone(),
        scene: opened,
        options,
        pixel_filter: args.look.pixel_filter(),
        near_plane: args.look.near_plane(),
        cameras: cameras.to_vec(),
        up: args.up.map(Triple::direction),
        size_px: args.size,
        mode: match args.present {
            PresentArg::Fifo => PresentMode::Fifo,
            PresentArg::Mailbox => PresentMode::Mailbox,
            PresentArg::Immediate => PresentMode::Immediate,
        },
        device: args.device.choice(),
        memory_budget_bytes: args.memory.budget(),
        memory: args.host_memory.of_scenes(),
        validation: device::validation(),
        frames: args.frames,
        path_cameras,
        screenshot: args.screenshot.clone(),
        script: VecDeque::new(),
        budget_ms: args.budget_ms,
        boxes: None,
    })
}

fn headless(args: &PlayerArgs, cameras: &[Camera], printer: &Printer) -> Result<(), CliError> {
    let opened = OpenedScene::open_warned(&args.scene, args.host_memory.of_scenes(), printer)?;
    let (options, counts) = (viewer_options(args, opened.scene())?, opened.counts());
    let gpu = device::open(args.device.choice())?;
    args.memory.limit(&gpu);
    let mut viewer = SceneViewer::of_opened(&gpu, opened, options)?;
    let path_cameras = path_cameras(args, viewer.scene(), cameras);
    let timings = play(&mut viewer, &path_cameras, args.frames.unwrap_or(1))?;
    if let Some(path) = &args.screenshot {
        viewer.screenshot(path)?;
    }
    device::check_validation(&gpu)?;
    let drawn = Drawn {
        device: gpu.caps().name.clone(),
        counts,
        scene_on_host_bytes: viewer.scene_on_host_bytes(),
        size_px: viewer.size_px().unwrap_or_default(),
        window: false,
    };
    print(args, &played(args, drawn, &timings), printer)
}

fn played(args: &PlayerArgs, drawn: Drawn, timings: &Timings) -> Played {
    let Drawn { device, counts: [stored, expanded], scene_on_host_bytes, size_px: resolution, window } = drawn;
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
        scene_on_host_bytes,
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
        "{}: {} frames of {width}x{height} {how}, {:.1} FPS ({:.2} ms)",
        played.device, played.frames, played.fps, played.ms.median
    ));
    if played.scene_on_host_bytes > 0 {
        printer.line(format_args!("{} bytes of the scene are in host memory", grouped(played.scene_on_host_bytes)));
    }
    if let Some(path) = &args.screenshot {
        printer.line(path.display());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;
    use glam::DVec3;

    use super::*;

    #[test]
    fn views_of_a_data_set_are_not_squeezed_into_the_size() {
        let args = PlayerArgs::parse_from(["instgs-player", "a.ply", "--size", "64x64"]);
        let view = Camera::look_at("a", DVec3::X, DVec3::ZERO, DVec3::Z, 0.8, (160, 90));
        let shown = path_cameras(&args, &InstancedScene::default(), std::slice::from_ref(&view)).remove(0);
        assert_eq!((shown.width, shown.height, shown.fx), (64, 64, shown.fy));
        assert!((shown.fy / 64.0 - view.fy / 90.0).abs() < 1e-12 && shown.view_from_world == view.view_from_world);
    }

    #[test]
    fn the_help_names_the_key_and_the_file_that_there_are() {
        let help = PlayerArgs::command().render_long_help().to_string();
        let words = help.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(words.contains("F1 lists the keys") && words.contains("save SCENE.boxes.json,"), "{words}");
    }
}
