//! Flags that several commands share: scenes, views, and rendering options.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;

use crate::error::CliError;
use crate::opened::SceneMemory;
use crate::printer::Printer;
use instgs_io::dataset::Split;
use instgs_io::page::up_beside;
use instgs_io::{IoError, LoadedScene, View, load_scene, load_scene_to_draw, read_cameras, read_views};
use instgs_vk::gpu::Gpu;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::camera::MAX_IMAGE_SIDE;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Camera, DevicePrecision, InstancedScene, NearPlane, PixelFilterChoice};

/// Picture size of `--orbit` without `--size`.
const ORBIT_SIZE: (u32, u32) = (1280, 720);

/// Source of a command's cameras: exactly one of the flags.
#[derive(Args)]
#[group(required = true, multiple = false)]
pub struct ViewSource {
    /// Views of a dataset folder: transforms_train/test.json, transforms.json, or COLMAP's sparse/0
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// N cameras on a circle around the scene's centre, named 000, 001 ...
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    orbit: Option<u32>,
    /// Camera file: one object or a list of {"name","width","height","fx","fy","cx","cy","view_from_world"}
    #[arg(long, value_name = "JSON")]
    camera: Option<PathBuf>,
}

/// Which cameras a command renders, and at which size.
#[derive(Args)]
pub struct ViewArgs {
    #[command(flatten)]
    source: ViewSource,
    /// Which views of --data [default: test]
    #[arg(long, value_enum, conflicts_with_all = ["orbit", "camera"])]
    split: Option<SplitArg>,
    /// Picture size; views of other sizes are scaled per axis [default: the views' own; 1280x720 with --orbit]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    size: Option<(u32, u32)>,
    /// Up axis of --orbit [default: that of the training cameras, if the scene lies in the folder of its run; else, for a
    /// flat scene, the one of -y, +z, +x nearest to its normal; else -y]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, conflicts_with_all = ["data", "camera"], allow_hyphen_values = true)]
    up: Option<Triple>,
}

/// Which views of a dataset.
#[derive(Clone, Copy, ValueEnum)]
pub enum SplitArg {
    /// The views of the test split.
    #[value(help = None)]
    Test,
    /// Views to train from.
    #[value(help = None)]
    Train,
    /// All views of the data set.
    #[value(help = None)]
    All,
}

impl SplitArg {
    /// The dataset's views of this split, at least one; what a user should know of how they were read is told.
    pub fn views(self, folder: &Path, printer: &Printer) -> Result<Vec<View>, CliError> {
        let (views, notes) = self.views_and_notes(folder)?;
        notes.iter().for_each(|note| printer.warning(note));
        Ok(views)
    }

    fn views_and_notes(self, folder: &Path) -> Result<(Vec<View>, Vec<String>), CliError> {
        let wanted = |of_view: Split| match self {
            Self::All => true,
            Self::Test => of_view == Split::Test,
            Self::Train => of_view == Split::Train,
        };
        let dataset = read_views(folder)?;
        let views: Vec<View> = dataset.views.into_iter().filter(|v| wanted(v.split)).collect();
        if views.is_empty() {
            return Err(IoError::new(folder, "has no views in this split").advise("try --split all").into());
        }
        Ok((views, dataset.notes))
    }
}

/// Three numbers separated by commas; a type of its own because clap takes a bare array for a list of values.
#[derive(Clone, Copy, Debug)]
pub struct Triple([f32; 3]);

impl Triple {
    /// The numbers as an f64 vector.
    pub fn direction(self) -> DVec3 {
        DVec3::from_array(self.0.map(f64::from))
    }
}

/// The circle of cameras around a scene. Up is as given, else that of the training cameras beside the scene's file, else a guess
/// ([`Orbit::around`]).
pub fn orbit_of(path: &Path, scene: &InstancedScene, given: Option<Triple>) -> Orbit {
    Orbit::around(scene, given.map(Triple::direction).or_else(|| up_beside(path, scene)))
}

impl ViewArgs {
    /// The selected cameras, at least one; `path` is the scene's file. Warns if the near plane would cut into what a circle of cameras
    /// sees of the scene.
    pub fn cameras(
        &self,
        path: &Path,
        scene: &InstancedScene,
        near: f32,
        printer: &Printer,
    ) -> Result<Vec<Camera>, CliError> {
        let cameras = match &self.source {
            ViewSource { data: Some(folder), .. } => self.dataset_cameras(folder, printer)?,
            ViewSource { camera: Some(path), .. } => read_cameras(path)?,
            ViewSource { orbit, .. } => {
                let circle = orbit_of(path, scene, self.up);
                // Half of the scene is within less than half the distance from the centre.
                if circle.distance < 1.5 * f64::from(near) {
                    let distance = circle.distance;
                    printer.warning(format_args!(
                        "the circle's cameras are {distance:.3} from the centre, and nothing nearer than {near} is \
                         drawn: use a smaller --near"
                    ));
                }
                circle.cameras(orbit.unwrap_or(1), self.size.unwrap_or(ORBIT_SIZE))
            }
        };
        let resized =
            |camera: Camera| self.size.map_or(camera.clone(), |(width, height)| camera.resized(width, height));
        Ok(cameras.into_iter().map(resized).collect())
    }

    /// The data set of `--data`.
    pub fn data(&self) -> Option<&Path> {
        self.source.data.as_deref()
    }

    /// The views of `--data`, at the size of their photos; `None` for cameras without photos and for `--size`. Their notes are
    /// told with their cameras.
    pub fn photos(&self) -> Result<Option<Vec<View>>, CliError> {
        match (&self.source.data, self.size) {
            (Some(folder), None) => {
                self.split.unwrap_or(SplitArg::Test).views_and_notes(folder).map(|(views, _)| Some(views))
            }
            _ => Ok(None),
        }
    }

    fn dataset_cameras(&self, folder: &Path, printer: &Printer) -> Result<Vec<Camera>, CliError> {
        let views = self.split.unwrap_or(SplitArg::Test).views(folder, printer)?;
        Ok(views.into_iter().map(|v| v.camera).collect())
    }
}

/// The flag of commands that print a table and whose report can be JSON, in a file or on stdout.
#[derive(Args)]
pub struct JsonArgs {
    /// Report as JSON: to this file, or without a file name to stdout instead of the table
    #[arg(long, value_name = "F", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
}

impl JsonArgs {
    /// True if stdout carries only the JSON report.
    pub fn on_stdout(&self) -> bool {
        self.json.as_deref() == Some(Path::new("-"))
    }

    /// Makes the folder of the file, so that a wrong path is found before the work.
    ///
    /// # Errors
    /// The folder cannot be made.
    pub fn create_folder(&self) -> Result<(), CliError> {
        self.json.as_deref().filter(|_| !self.on_stdout()).map_or(Ok(()), create_folder_of)
    }

    /// Writes the report as the flag says; returns whether the table is to be printed.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, report: &impl serde::Serialize, printer: &Printer) -> Result<bool, CliError> {
        match &self.json {
            Some(_) if self.on_stdout() => printer.json(report)?,
            Some(path) => printer.json_file(path, report)?,
            None => {}
        }
        Ok(!self.on_stdout())
    }
}

/// Rendering options: background, near plane, antialiasing, dilation.
#[derive(Args)]
pub struct LookArgs {
    /// Background colour, three sRGB values from 0 to 1 [default: 0,0,0]
    #[arg(long, value_name = "R,G,B", value_parser = parse_color, allow_hyphen_values = true)]
    background: Option<Triple>,
    /// Depth of the near plane, scene units [default: the scene's, which is 0.2 unless it was trained with another]
    #[arg(long, value_name = "Z", value_parser = parse_near)]
    near: Option<f32>,
    /// Opacity compensation for small splats; --antialias=false turns it off [default: the scene's setting]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    antialias: Option<bool>,
    /// Variance added to every projected splat, px^2 [default: the scene's, which is 0.3 unless it was trained with another]
    #[arg(long, value_name = "PX2", value_parser = parse_dilation)]
    dilation: Option<f32>,
    /// Limit on the buffers of visible chunks; frames that need more are drawn in depth ranges, with the same result.
    /// All chunks that reach through one depth must fit
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    max_chunks: Option<u32>,
    /// Limit on the buffer of intersections; frames that need more are drawn in depth slabs, with the same result
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    max_intersections: Option<u32>,
    /// Leave out what the front of the scene hides: the same picture to the bit, in less time and memory where much is hidden
    #[arg(long)]
    occlusion: bool,
}

/// The flag for the budget of device memory.
#[derive(Args)]
pub struct MemoryArgs {
    /// Device memory to draw with, the scene included, MiB; frames that need more are drawn in parts, and a scene that takes
    /// most of it stays in host memory, with the same result; of a scene in pages, fewer are there [default: what the device has]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    device_memory_mb: Option<u32>,
}

impl MemoryArgs {
    /// Bytes of device memory to draw with; `u64::MAX` = what the device has.
    pub fn budget(&self) -> u64 {
        self.device_memory_mb.map_or(u64::MAX, |mib| u64::from(mib) << 20)
    }

    /// Sets the budget of the device.
    pub fn limit(&self, gpu: &Gpu) {
        gpu.set_memory_budget(self.budget());
    }

    /// The render options with frames divided, and scenes on the host, where memory, or the budget, is too small.
    pub fn apply(&self, options: RenderOptions) -> RenderOptions {
        RenderOptions { divide_for_memory: true, ..options }
    }
}

/// The flag for the budget of host memory, for commands that can draw a scene in pages.
#[derive(Args)]
pub struct HostMemoryArgs {
    /// Host memory to read the scene with, MiB; of a scene with pages (export --pages) that needs more, only what views want is
    /// read [default: what is available]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24))]
    host_memory_mb: Option<u32>,
}

impl HostMemoryArgs {
    /// The memory for scenes.
    pub fn of_scenes(&self) -> SceneMemory {
        SceneMemory { host_bytes: self.host_memory_mb.map(|mib| u64::from(mib) << 20) }
    }
}

/// The level-of-detail flag, for commands whose pictures are viewed rather than measured.
#[derive(Args)]
pub struct LodArgs {
    /// Merge distant Gaussians, with an error of at most PX pixels; `bench --lod` measures the effect [default: off]
    #[arg(long, value_name = "PX", value_parser = parse_lod)]
    lod: Option<f32>,
}

impl LodArgs {
    /// The render options with the flag's error.
    pub fn apply(&self, options: RenderOptions) -> RenderOptions {
        RenderOptions { lod_error_px: self.lod.unwrap_or(0.0), ..options }
    }
}

/// The flag for the numbers of a scene on the device, for commands that draw without learning or judging.
#[derive(Args)]
pub struct PrecisionArgs {
    /// Numbers of the scene in device memory: f32, f16 (half the bytes; pictures differ by a hundredth of a dB), or q8, which
    /// is f16 with offsets in 8 bits
    #[arg(long, value_name = "P", value_parser = parse_precision, default_value = "f16")]
    device_precision: DevicePrecision,
}

impl PrecisionArgs {
    /// The precision.
    pub fn precision(&self) -> DevicePrecision {
        self.device_precision
    }

    /// The render options with the flag's precision.
    pub fn apply(&self, options: RenderOptions) -> RenderOptions {
        RenderOptions { device_precision: self.device_precision, ..options }
    }
}

impl LookArgs {
    /// What the flags ask of the pixel filter.
    pub fn pixel_filter(&self) -> PixelFilterChoice {
        PixelFilterChoice { dilation_px2: self.dilation, antialias: self.antialias }
    }

    /// The near plane, if the flags name one.
    pub fn near_plane(&self) -> Option<NearPlane> {
        self.near.map(NearPlane)
    }

    /// The options for a scene: the flags, else the scene's own, else the defaults.
    pub fn options(&self, scene: &InstancedScene) -> RenderOptions {
        let default = RenderOptions::default();
        RenderOptions {
            near: self.near_plane().unwrap_or(scene.near_plane).0,
            background: self.background.map_or(default.background, |b| b.0),
            lod_error_px: default.lod_error_px,
            max_chunks: self.max_chunks,
            max_intersections: self.max_intersections,
            occlusion: self.occlusion,
            ..default
        }
        .filtered(self.pixel_filter().over(scene.pixel_filter))
    }
}

/// Opens a scene and prints warnings about its file.
pub fn open_scene(path: &Path, printer: &Printer) -> Result<LoadedScene, CliError> {
    warned(path, load_scene(path)?, printer)
}

/// As [`open_scene`], with the background in an order that is fast to draw.
pub fn open_scene_to_draw(path: &Path, printer: &Printer) -> Result<LoadedScene, CliError> {
    warned(path, load_scene_to_draw(path)?, printer)
}

fn warned(path: &Path, loaded: LoadedScene, printer: &Printer) -> Result<LoadedScene, CliError> {
    for what in loaded.warnings() {
        printer.warning(format_args!("{}: {what}", path.display()));
    }
    Ok(loaded)
}

/// The absolute form of a path that a flag gives: the configuration keeps it, and a run may be resumed from another folder.
///
/// # Errors
/// The path is not UTF-8 text, or the current folder is unknown.
pub fn absolute(flag: &str, path: &Path) -> Result<String, CliError> {
    let fail = |what: String| CliError::msg(format!("{flag}: {what}"));
    let absolute = std::path::absolute(path).map_err(|e| fail(format!("{}: {e}", path.display())))?;
    absolute.into_os_string().into_string().map_err(|p| fail(format!("{} is not UTF-8 text", p.display())))
}

/// Creates a folder and its parents.
pub fn create_folder(path: &Path) -> Result<(), CliError> {
    Ok(instgs_io::run_folder::create(path)?)
}

/// Creates the folder of a file before the work whose result it will hold.
///
/// # Errors
/// The folder cannot be created.
pub fn create_folder_of(file: &Path) -> Result<(), CliError> {
    Ok(instgs_io::run_folder::create_for(file)?)
}

/// Parses the name of a precision.
pub fn parse_precision(text: &str) -> Result<DevicePrecision, String> {
    let found = DevicePrecision::ALL.into_iter().find(|precision| precision.name() == text);
    found.ok_or_else(|| "want f32, f16 or q8".into())
}

/// Parses a picture size `WxH`, pixels.
pub fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let side = |text: &str| text.parse().ok().filter(|side| (1..=MAX_IMAGE_SIDE).contains(side));
    let sides = text.split_once(['x', 'X']).and_then(|(w, h)| Some((side(w)?, side(h)?)));
    sides.ok_or_else(|| format!("want WxH with sides of 1 to {MAX_IMAGE_SIDE} pixels, for instance 800x450"))
}

/// Parses `X,Y,Z`, three finite numbers.
pub fn parse_triple(text: &str) -> Result<Triple, String> {
    let parts: Vec<f32> =
        text.split(',').map_while(|part| part.trim().parse().ok().filter(|v: &f32| v.is_finite())).collect();
    match <[f32; 3]>::try_from(parts) {
        Ok(values) if text.split(',').count() == 3 => Ok(Triple(values)),
        _ => Err("want three numbers separated by commas, for instance 0,0.5,1".into()),
    }
}

/// Parses a colour `R,G,B`, three numbers from 0 to 1.
pub fn parse_color(text: &str) -> Result<Triple, String> {
    let color = parse_triple(text)?;
    let is_shown = color.0.iter().all(|part| (0.0..=1.0).contains(part));
    if is_shown { Ok(color) } else { Err("want values from 0 to 1, for instance 1,1,1 for white".into()) }
}

/// Parses an up axis `X,Y,Z` of any length but zero.
pub fn parse_up(text: &str) -> Result<Triple, String> {
    let up = parse_triple(text)?;
    if up.0 == [0.0; 3] { Err("a vector of length 0 has no direction".into()) } else { Ok(up) }
}

/// Parses the depth of a near plane, scene units.
pub fn parse_near(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|v: &f32| v.is_finite() && *v >= 0.0).ok_or_else(|| "want a number >= 0".into())
}

/// Parses a level-of-detail error in pixels: above 0, and at most the largest picture size.
pub fn parse_lod(text: &str) -> Result<f32, String> {
    let most = MAX_IMAGE_SIDE as f32;
    let px = text.trim().parse().ok().filter(|v: &f32| *v > 0.0 && *v <= most);
    px.ok_or_else(|| format!("want a number of pixels above 0, to {most}, for instance 2"))
}

fn parse_dilation(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|v: &f32| (1e-6..=1e6).contains(v)).ok_or_else(|| "want a number from 1e-6 to 1e6".into())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        look: LookArgs,
    }

    #[test]
    fn a_background_of_bytes_is_refused() {
        let background =
            |text: &str| Line::try_parse_from(["x", "--background", text]).map(|line| line.look.background);
        assert!(background("255,255,255").is_err_and(|error| error.to_string().contains("from 0 to 1")));
        assert_eq!(background("1,1,1").ok().flatten().map(|color| color.0), Some([1.0; 3]));
    }

    #[test]
    fn sizes_and_triples() {
        assert_eq!(parse_size("800x450"), Ok((800, 450)));
        assert_eq!(parse_triple("0, 0.5,-1").map(|t| t.0), Ok([0.0, 0.5, -1.0]));
        for bad in ["", "800", "0x1", "x", "800x", "99999x1", "-1x2"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
        for bad in ["", "1", "1,2", "1,2,3,4", "1,2,x", "1,nan,2", "1,2,3,", "a,1,2,3"] {
            assert!(parse_triple(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_color("0,0.5,1").map(|t| t.0), Ok([0.0, 0.5, 1.0]));
        for bad in ["255,255,255", "0,0,1.01", "-0.1,0,0"] {
            assert!(parse_color(bad).is_err_and(|text| text.contains("from 0 to 1")), "{bad}");
        }
        assert!(parse_up("0,0,0").is_err() && parse_near("-1").is_err() && parse_near("nan").is_err());
        assert!(parse_lod("2") == Ok(2.0) && ["0", "-1", "nan", "1e9", "x"].iter().all(|t| parse_lod(t).is_err()));
        assert!(parse_dilation("0").is_err() && parse_dilation("0.3").is_ok());
    }
}
