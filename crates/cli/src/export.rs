//! `instgs-vk export`: writes a scene in another file format.

use std::fs::Metadata;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::export_page;
use instgs_console::args::{Triple, open_scene, orbit_of, parse_near, parse_up};
use instgs_console::device::DeviceArgs;
use instgs_console::table::grouped;
use instgs_console::{CliError, Printer, device};
use instgs_io::small::{SmallOptions, SmallPlan};
use instgs_io::{
    ExportFormat, ExportedScene, IoError, Pack, RunFolder, export_scene, write_planned_scene_file,
    write_scene_file_in_pages,
};
use instgs_objects::pipeline::config::ConfigBuilder;
use instgs_train::config::{ConfigError, TrainConfig};
use instgs_train::{FinishJob, USUAL_PICTURE_PSNR_DB, finish, measure_sensitivity, sensitivity_cameras};
use instgs_vk::scene::{InstancedScene, NearPlane};

/// Writes a scene as .ply, .spz or .sog (instances are expanded into plain Gaussians), as .glb (glTF with
/// KHR_gaussian_splatting: instances become nodes that share their template's data), as OpenUSD, as .instgs, as .html (one file
/// that holds the packed scene and draws it in a browser, without a server), or as a folder (its name ends in a slash) of a .sog
/// for each template and the background, and scene_graph.json, which says where the instances are.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk export --scene room.instgs --to room.ply\n  \
    instgs-vk export --scene room.instgs --to small.instgs --pack small --data room\n  \
    instgs-vk export --scene room.instgs --to small.instgs --pack small --data room --picture-psnr 47 --finish 400\n  \
    instgs-vk export --scene room.ply --to room.spz\n  \
    instgs-vk export --scene room.instgs --to room.sog\n  \
    instgs-vk export --scene room.instgs --to parts/\n  \
    instgs-vk export --scene room.instgs --to room.glb --up 0,0,1\n  \
    instgs-vk export --scene room.instgs --to room.usdc\n  \
    instgs-vk export --scene room.instgs --to room.html\n  \
    instgs-vk export --scene city.ply --to city.instgs --pack f16 --pages")]
pub(super) struct ExportArgs {
    /// Scene to convert: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(long, value_name = "S")]
    pub(super) scene: PathBuf,
    /// File to write: .ply, .spz, .sog, .glb, .usda, .usdc, .instgs or .html; or a folder, with a slash at its end
    #[arg(long, value_name = "X.(ply|spz|sog|glb|usda|usdc|instgs|html)|DIR/")]
    pub(super) to: PathBuf,
    /// Number format of an .instgs file [default: f32], or of the scene in an .html [default: small]. f32: as they are. f16: 16
    /// bits, except means and transforms. q8: offsets in 8 bits but those of shape, the rest as f16. small: everything rounded
    /// and entropy coded, with --data only as precisely as its views need
    #[arg(long, value_enum)]
    pack: Option<PackArg>,
    /// Dataset whose training views say how precise --pack small must be: far fewer bytes for the same pictures. Photos
    /// are not read, only cameras, but for --finish
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Closeness of pictures of the packed scene to those of the unpacked one as predicted for small errors, dB of PSNR; they
    /// come out some 3 dB lower. Lower is smaller
    #[arg(long, value_name = "DB", default_value_t = USUAL_PICTURE_PSNR_DB, requires = "data", value_parser = parse_psnr)]
    pub(super) picture_psnr: f64,
    /// Number of steps in which the scene is trained on the photos of --data through the rounding of --pack small, so that what the
    /// file holds looks like them: with 400, files of the same PSNR are some 15 % smaller. Photos are taken as the run in whose
    /// folder the scene lies was trained on them. 0 = the scene is not trained
    #[arg(long, value_name = "STEPS", default_value_t = 0, requires = "data", value_parser = clap::value_parser!(u64).range(..=100_000))]
    finish: u64,
    /// Depth of the near plane, scene units, for the views of --data and for the file: what a scene was trained with that does not
    /// say so [default: the scene's, which is 0.2 unless it was trained with another]
    #[arg(long, value_name = "Z", value_parser = parse_near)]
    near: Option<f32>,
    /// Direction of the scene that becomes up (+y) in a .glb or OpenUSD file, or points up in an .html [default: as for render's
    /// --orbit]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    pub(super) up: Option<Triple>,
    /// Write a .glb in which all Gaussians are one mesh, instances expanded, for viewers that put whole meshes in order and so
    /// draw the background over objects (Babylon.js)
    #[arg(long)]
    one_mesh: bool,
    /// Write an .instgs whose background is in pages, with levels of detail: render reads only those that its views want,
    /// where memory is short. Other programs see a scene like any other; edits leave pages out
    #[arg(long)]
    pages: bool,
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
    /// Number of Gaussians in the new file: expanded, or the stored ones for .glb, .instgs, .html and a folder.
    gaussians: u64,
    flattened_instances: usize,
    /// Length of the file, or of all files of the folder; `None` if it went to a pipe or a device.
    bytes: Option<u64>,
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

/// How the scene is rounded for the views of a data set; with `--finish`, the scene is trained for that.
fn planned(
    args: &ExportArgs,
    scene: &mut InstancedScene,
    data: &Path,
    device_args: &DeviceArgs,
    printer: &Printer,
) -> Result<SmallPlan, CliError> {
    let cameras = sensitivity_cameras(data)?;
    let gpu = device::open(device_args.choice())?;
    let mut progress = printer.progress("views", cameras.len() as u64);
    let sensitivity = &measure_sensitivity::<CliError>(&gpu, scene, &cameras, || {
        progress.step("measured");
        Ok(())
    })?;
    drop(progress);
    let picture_psnr_db = args.picture_psnr;
    let plan = if args.finish > 0 {
        let config = config_or_default(&args.scene, printer);
        let mut progress = printer.progress("steps", args.finish);
        let (to, config) = (&args.to, &config);
        let job = FinishJob { scene, sensitivity, picture_psnr_db, data, config, to, steps: args.finish };
        let finished = finish::<CliError>(&gpu, &job, || {
            progress.step("finished");
            Ok(())
        })?;
        finished.warnings.iter().for_each(|warning| printer.warning(warning));
        *scene = finished.scene;
        finished.plan
    } else {
        SmallPlan::new(scene, &SmallOptions { sensitivity, picture_psnr_db }, &args.to)?
    };
    device::check_validation(&gpu)?;
    Ok(plan)
}

/// The configuration of the run that a scene lies in: how its training took the photos. With a warning the default, if there is none
/// or none that can be read.
fn config_or_default(scene: &Path, printer: &Printer) -> TrainConfig {
    let reason = match config_beside(scene) {
        Ok(Some(config)) => return config,
        Ok(None) => format!("{}: lies in no run's folder, which would say how it was trained", scene.display()),
        Err(error) => error.to_string(),
    };
    printer.warning(format_args!(
        "{reason}: photos are taken whole, without the masks of --pixel-masks, and black stands behind all splats"
    ));
    TrainConfig::default()
}

/// The configuration of the run that a scene lies in; `None` if it lies in none.
///
/// # Errors
/// The run's configuration cannot be read.
pub(super) fn config_beside(scene: &Path) -> Result<Option<TrainConfig>, ConfigError> {
    let file = RunFolder::new(scene.parent().unwrap_or(Path::new("."))).config();
    if !file.is_file() {
        return Ok(None);
    }
    let config = ConfigBuilder::new().run_file(&file).and_then(ConfigBuilder::finish)?;
    Ok(Some(config.train))
}

/// Writes the scene in the format.
fn write(
    args: &ExportArgs,
    scene: &InstancedScene,
    format: ExportFormat,
    plan: Option<&SmallPlan>,
    printer: &Printer,
) -> Result<ExportedScene, CliError> {
    let to = args.to.as_path();
    let mut exported = ExportedScene { gaussians: scene.source_len() as u64, ..ExportedScene::default() };
    match (format, plan) {
        (ExportFormat::Instgs(pack), _) if args.pages => write_scene_file_in_pages(to, scene, pack)?,
        (ExportFormat::Page(pack), _) => export_page::write(args, scene, pack, plan, printer)?,
        (ExportFormat::Instgs(Pack::Small), Some(plan)) => write_planned_scene_file(to, scene, plan)?,
        _ => {
            let up = orbit_of(&args.scene, scene, args.up).up;
            exported = export_scene(to, scene, format, up)?;
        }
    }
    exported.notes(to, scene, format).iter().for_each(|note| printer.warning(note));
    Ok(exported)
}

pub(super) fn run(args: &ExportArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let to = args.to.as_path();
    let mut format = ExportFormat::of(to, args.pack.map(Pack::from))?;
    if args.one_mesh {
        format = format.in_one_mesh(to)?;
    }
    if args.up.is_some() && !format.has_up() {
        printer.warning("--up is for .glb, .usda, .usdc and .html: other formats keep the scene's axes");
    }
    if args.pages && !matches!(format, ExportFormat::Instgs(_)) {
        return Err(IoError::new(to, "--pages is for .instgs files")
            .advise("leave it out, or export to .instgs")
            .into());
    }
    if args.pages && args.finish > 0 {
        return Err(IoError::new(to, "--finish is for --pack small, which has no pages")
            .advise("leave one of the two out")
            .into());
    }
    if args.pages && format == ExportFormat::Instgs(Pack::Small) {
        return Err(IoError::new(to, "cannot have pages: small files are coded as a whole")
            .advise("use --pack f16")
            .into());
    }
    let mut scene = open_scene(&args.scene, printer)?.scene;
    scene.near_plane = args.near.map_or(scene.near_plane, NearPlane);
    if args.pages {
        scene.order_background();
    }
    let is_small = matches!(format, ExportFormat::Instgs(Pack::Small) | ExportFormat::Page(Pack::Small));
    if args.data.is_some() && !is_small {
        printer.warning("--data and --finish are for --pack small: other formats keep one precision everywhere");
    }
    let data = args.data.as_ref().filter(|_| is_small);
    format.create_folder(to)?;
    let plan = data.map(|data| planned(args, &mut scene, data, device_args, printer)).transpose()?;
    let ExportedScene { gaussians, folder_bytes, .. } = write(args, &scene, format, plan.as_ref(), printer)?;
    let flattened_instances = if format.is_expanded() { scene.instances.len() } else { 0 };
    let bytes = match format {
        ExportFormat::SogFolder => Some(folder_bytes),
        _ => std::fs::metadata(to).ok().filter(Metadata::is_file).map(|file| file.len()),
    };
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
    let bytes = bytes.map(|bytes| format!(", {} bytes", grouped(bytes))).unwrap_or_default();
    printer.line(format_args!("{}: {} Gaussians{how}{bytes}", report.to, grouped(gaussians)));
    Ok(())
}
