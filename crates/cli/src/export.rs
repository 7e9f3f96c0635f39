//! `instgs-vk export`: writes a scene in another file format.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use instgs_console::args::{Triple, open_scene, parse_up};
use instgs_console::device::DeviceArgs;
use instgs_console::table::grouped;
use instgs_console::{CliError, Printer, device};
use instgs_io::{ExportFormat, Pack, export_scene};
use instgs_train::{USUAL_PICTURE_PSNR_DB, sensitivity_cameras, write_small};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::trajectory::Orbit;

/// Writes a scene as .ply, .spz or .sog (instances are expanded into plain Gaussians), as .glb (glTF with
/// KHR_gaussian_splatting: instances become nodes that share their template's data), or as .instgs.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk export --scene room.instgs --to room.ply\n  \
    instgs-vk export --scene room.instgs --to small.instgs --pack small --data room\n  \
    instgs-vk export --scene room.ply --to room.spz\n  \
    instgs-vk export --scene room.instgs --to room.sog\n  \
    instgs-vk export --scene room.instgs --to room.glb --up 0,0,1\n  \
    instgs-vk export --scene room.instgs --to room.usda")]
pub(super) struct ExportArgs {
    /// Scene to convert: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(long, value_name = "S")]
    scene: PathBuf,
    /// File to write: .ply, .spz, .sog, .glb, .usda or .instgs
    #[arg(long, value_name = "X.(ply|spz|sog|glb|usda|instgs)")]
    to: PathBuf,
    /// Number format of an .instgs file. f32: as they are. f16: 16 bits, except means and transforms. q8: offsets in 8
    /// bits, the rest as f16. small: everything rounded and entropy coded, with --data only as precisely as its views need
    #[arg(long, value_enum)]
    pack: Option<PackArg>,
    /// Dataset whose training views say how precise --pack small must be: far fewer bytes for the same pictures. Photos
    /// are not read, only cameras
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Closeness of pictures of the packed scene to those of the unpacked one as predicted for small errors, dB of PSNR; they
    /// come out some 3 dB lower. Lower is smaller
    #[arg(long, value_name = "DB", default_value_t = USUAL_PICTURE_PSNR_DB, requires = "data", value_parser = parse_psnr)]
    picture_psnr: f64,
    /// Direction of the scene that becomes up (+y) in a .glb or .usda [default: as for render's --orbit]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    up: Option<Triple>,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

fn parse_psnr(text: &str) -> Result<f64, String> {
    let psnr: f64 = text.parse().map_err(|_| format!("\"{text}\" is no number"))?;
    if (10.0..=120.0).contains(&psnr) { Ok(psnr) } else { Err("must be from 10 to 120 dB".into()) }
}

#[derive(Clone, Copy, ValueEnum)]
enum PackArg {
    F32,
    F16,
    Q8,
    Small,
}

#[derive(serde::Serialize)]
struct Exported {
    scene: String,
    to: String,
    /// Number of Gaussians in the new file: expanded, or the stored ones for .glb and .instgs.
    gaussians: u64,
    flattened_instances: usize,
    bytes: u64,
}

impl From<PackArg> for Pack {
    fn from(pack: PackArg) -> Self {
        match pack {
            PackArg::F32 => Self::F32,
            PackArg::F16 => Self::F16,
            PackArg::Q8 => Self::Q8,
            PackArg::Small => Self::Small,
        }
    }
}

/// Writes the scene as small as the views of a data set allow.
fn pack_small(
    args: &ExportArgs,
    scene: &InstancedScene,
    data: &Path,
    device_args: &DeviceArgs,
    printer: &Printer,
) -> Result<(), CliError> {
    let cameras = sensitivity_cameras(data)?;
    let gpu = device::open(device_args.choice())?;
    let mut progress = printer.progress("views", cameras.len() as u64);
    write_small(&gpu, &args.to, scene, &cameras, args.picture_psnr, || progress.step("measured"))?;
    drop(progress);
    device::check_validation(&gpu)
}

pub(super) fn run(args: &ExportArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let to = args.to.as_path();
    let format = ExportFormat::of(to, args.pack.map(Pack::from))?;
    if args.up.is_some() && !matches!(format, ExportFormat::Glb | ExportFormat::Usda) {
        printer.warning("--up is for .glb and .usda: other formats keep the scene's axes");
    }
    let scene = open_scene(&args.scene, printer)?.scene;
    let gaussians = match &args.data {
        Some(data) if format == ExportFormat::Instgs(Pack::Small) => {
            pack_small(args, &scene, data, device_args, printer)?;
            scene.source_len() as u64
        }
        _ => {
            let up = Orbit::around(&scene, args.up.map(Triple::direction)).up;
            let exported = export_scene(to, &scene, format, up)?;
            exported.notes(to, &scene, format).iter().for_each(|note| printer.warning(note));
            exported.gaussians
        }
    };
    if args.data.is_some() && format != ExportFormat::Instgs(Pack::Small) {
        printer.warning("--data is for --pack small: other formats keep one precision everywhere");
    }
    let flattened_instances = if format.is_expanded() { scene.instances.len() } else { 0 };
    let bytes = std::fs::metadata(to).map_or(0, |m| m.len());
    let report = Exported {
        scene: args.scene.display().to_string(),
        to: to.display().to_string(),
        gaussians,
        flattened_instances,
        bytes,
    };
    if args.json {
        return printer.json(&report);
    }
    let how =
        if flattened_instances > 0 { format!(", {flattened_instances} instances expanded") } else { String::new() };
    printer.line(format_args!("{}: {} Gaussians{how}, {} bytes", report.to, grouped(gaussians), grouped(bytes)));
    Ok(())
}
