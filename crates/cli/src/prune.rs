//! `instgs-vk prune`: fewer Gaussians for nearly the same pictures.

use std::path::PathBuf;

use clap::Args;

use instgs_console::args::{create_folder_of, open_scene, orbit_of, parse_near};
use instgs_console::device::DeviceArgs;
use instgs_console::table::grouped;
use instgs_console::{CliError, Printer, device};
use instgs_io::{ExportFormat, Split, export_scene, packing_lost, read_views};
use instgs_train::pruning::{picture_psnr, prune};
use instgs_vk::scene::{Camera, NearPlane};

/// Removes the Gaussians that pictures show least of: the scene gets smaller and draws faster. Each is judged by its weight in the
/// pixels of a data set's training views, in every instance on its own; photos are not read, only cameras.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk prune --scene room.instgs --data room --keep 0.7 --out lean.instgs\n  \
    instgs-vk prune --scene room.ply --data room --keep 0.5 --out lean.ply")]
pub(super) struct PruneArgs {
    /// Scene to prune: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(long, value_name = "S")]
    scene: PathBuf,
    /// Data set whose training views say what shows
    #[arg(long, value_name = "DIR")]
    data: PathBuf,
    /// Part of the Gaussians that is kept, of those that are drawn: instances expanded
    #[arg(long, value_name = "PART", value_parser = parse_part)]
    keep: f64,
    /// Depth of the near plane, scene units: what a scene was trained with that does not say so [default: the scene's, which is 0.2
    /// unless it was trained with another]
    #[arg(long, value_name = "Z", value_parser = parse_near)]
    near: Option<f32>,
    /// File to write: .instgs, or .ply, .spz or .sog if the scene has no instances
    #[arg(long, value_name = "S2")]
    out: PathBuf,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

fn parse_part(text: &str) -> Result<f64, String> {
    let part: f64 = text.parse().map_err(|_| format!("\"{text}\" is no number"))?;
    if part > 0.0 && part <= 1.0 { Ok(part) } else { Err("must be above 0 and at most 1".into()) }
}

#[derive(serde::Serialize)]
struct Report {
    scene: String,
    out: String,
    /// Number of Gaussians after expanding instances, before and afterwards; hidden ones are not counted.
    drawn_before: u64,
    drawn: u64,
    /// Gaussians that single instances no longer show from now on, though their template still has them.
    hidden: u64,
    /// Number of stored Gaussians.
    gaussians: u64,
    /// PSNR between the training views' pictures of the two scenes, dB.
    picture_psnr: f64,
    bytes: u64,
}

pub(super) fn run(args: &PruneArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let format = ExportFormat::of(&args.out, None)?;
    let mut scene = open_scene(&args.scene, printer)?.scene;
    scene.near_plane = args.near.map_or(scene.near_plane, NearPlane);
    let is_kept_as_it_is = matches!(format, ExportFormat::Instgs(_))
        || scene.instances.is_empty() && matches!(format, ExportFormat::Ply | ExportFormat::Spz | ExportFormat::Sog);
    if !is_kept_as_it_is {
        let what = if scene.instances.is_empty() { ".instgs, .ply, .spz or .sog" } else { ".instgs" };
        return Err(CliError::msg(format!(
            "{}: a pruned scene is written as {what}; export then makes other files of it",
            args.out.display()
        )));
    }
    let dataset = read_views(&args.data)?;
    let cameras: Vec<Camera> = dataset.split(Split::Train).map(|view| view.camera.clone()).collect();
    create_folder_of(&args.out)?;
    let gpu = device::open(device_args.choice())?;
    let mut progress = printer.progress("views", cameras.len() as u64);
    let pruned = prune(&gpu, &scene, &cameras, args.keep, || progress.step("rendered"))?;
    drop(progress);
    let picture_psnr = picture_psnr(&gpu, [&scene, &pruned.scene], &cameras)?;
    device::check_validation(&gpu)?;
    let up = orbit_of(&args.scene, &scene, None).up;
    // The file may be the scene's own.
    let lost = packing_lost(&args.scene).filter(|_| matches!(format, ExportFormat::Instgs(_)));
    let exported = export_scene(&args.out, &pruned.scene, format, up)?;
    exported.notes(&args.out, &pruned.scene, format).iter().chain(&lost).for_each(|note| printer.warning(note));
    let report = Report {
        scene: args.scene.display().to_string(),
        out: args.out.display().to_string(),
        drawn_before: pruned.drawn + pruned.fewer,
        drawn: pruned.drawn,
        hidden: pruned.hidden,
        gaussians: pruned.scene.source_len() as u64,
        picture_psnr,
        bytes: std::fs::metadata(&args.out).map_or(0, |m| m.len()),
    };
    if args.json {
        return printer.json(&report);
    }
    let (drawn, before, bytes) = (grouped(report.drawn), grouped(report.drawn_before), grouped(report.bytes));
    printer.line(format_args!(
        "{}: draws {drawn} of {before} Gaussians, {bytes} bytes; {picture_psnr:.1} dB between pictures of the two",
        report.out
    ));
    Ok(())
}
