//! `instgs-vk export`: a scene in another file format.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::args::{Triple, open_scene, parse_up};
use super::error::CliError;
use super::printer::Printer;
use super::table::grouped;
use crate::io::glb::glb_data_bytes;
use crate::io::{IoError, Pack, write_glb, write_ply, write_scene_file_packed, write_spz};
use crate::scene::InstancedScene;
use crate::scene::gaussians::sh_coefficients;
use crate::scene::trajectory::Orbit;

/// Writes a scene as .ply or .spz (every instance expanded into Gaussians of its own), as .glb (glTF with
/// KHR_gaussian_splatting: instances stay nodes that share their template's data), or as .instgs.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk export --scene room.instgs --to room.ply\n  \
    instgs-vk export --scene room.instgs --to small.instgs --pack q8\n  \
    instgs-vk export --scene room.ply --to room.spz\n  \
    instgs-vk export --scene room.instgs --to room.glb --up 0,0,1")]
pub(super) struct ExportArgs {
    /// Scene: .instgs, .ply, .spz or .splat
    #[arg(long, value_name = "S")]
    scene: PathBuf,
    /// File to write: .ply, .spz, .glb or .instgs
    #[arg(long, value_name = "X.(ply|spz|glb|instgs)")]
    to: PathBuf,
    /// Numbers of an .instgs file: f32 as they are; f16 all but means and transforms in 16 bits; q8 offsets in 8 bits,
    /// the rest as f16
    #[arg(long, value_enum)]
    pack: Option<PackArg>,
    /// The scene's direction that becomes glTF's up (+y) in a .glb [default: as for render's --orbit]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    up: Option<Triple>,
    /// Report as JSON
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum PackArg {
    F32,
    F16,
    Q8,
}

#[derive(serde::Serialize)]
struct Exported {
    scene: String,
    to: String,
    /// In the new file: expanded, or of templates and background for .glb and .instgs.
    gaussians: u64,
    flattened_instances: usize,
    bytes: u64,
}

#[derive(Clone, Copy)]
enum Target {
    Ply,
    Spz,
    Instgs(Pack),
    Glb,
}

pub(super) fn run(args: &ExportArgs, printer: &Printer) -> Result<(), CliError> {
    let to = args.to.as_path();
    let target = target(args)?;
    if args.up.is_some() && !matches!(target, Target::Glb) {
        printer.warning("--up is for .glb: other formats keep the scene's axes");
    }
    let scene = open_scene(&args.scene, printer)?.scene;
    let gaussians = write(args, target, &scene)?;
    if matches!(target, Target::Ply | Target::Glb) && scene.antialias {
        let ending = if matches!(target, Target::Ply) { ".ply" } else { ".glb" };
        printer.warning(format_args!(
            "{}: {ending} has no place for the scene's antialias flag; render it with --antialias",
            to.display()
        ));
    }
    let flattened_instances = if matches!(target, Target::Ply | Target::Spz) { scene.instances.len() } else { 0 };
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

/// Writes the file; returns how many Gaussians it holds.
fn write(args: &ExportArgs, target: Target, scene: &InstancedScene) -> Result<u64, CliError> {
    let to = args.to.as_path();
    let stored = (scene.templates.len() + scene.background.len()) as u64;
    match target {
        Target::Instgs(pack) => write_scene_file_packed(to, scene, pack)?,
        Target::Glb => {
            check_memory(args, "its Gaussians take", glb_data_bytes(scene))?;
            write_glb(to, scene, Orbit::around(scene, args.up.map(Triple::direction)).up)?;
        }
        Target::Ply | Target::Spz => {
            check_expanded_memory(args, scene)?;
            let cloud = scene.flatten();
            match target {
                Target::Spz => write_spz(to, &cloud, scene.antialias)?,
                _ => write_ply(to, &cloud)?,
            }
            return Ok(cloud.len() as u64);
        }
    }
    Ok(stored)
}

fn target(args: &ExportArgs) -> Result<Target, CliError> {
    let ending = args.to.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let fail = |what: String| Err(IoError::new(&args.to, what).advise("export to .ply, .spz, .glb or .instgs").into());
    let pack = match args.pack {
        None | Some(PackArg::F32) => Pack::F32,
        Some(PackArg::F16) => Pack::F16,
        Some(PackArg::Q8) => Pack::Q8,
    };
    match ending.as_str() {
        "instgs" => Ok(Target::Instgs(pack)),
        _ if args.pack.is_some() => Err(IoError::new(&args.to, "--pack is for .instgs files")
            .advise("leave it out, or export to .instgs")
            .into()),
        "ply" => Ok(Target::Ply),
        "spz" => Ok(Target::Spz),
        "glb" => Ok(Target::Glb),
        other => fail(format!("unknown format \".{other}\"")),
    }
}

/// Flattening holds the cloud and the file's bytes at once.
fn check_expanded_memory(args: &ExportArgs, scene: &InstancedScene) -> Result<(), CliError> {
    let bytes_per_gaussian = 2 * 4 * (14 + 3 * sh_coefficients(scene.sh_degree()) as u64);
    let need = scene.expanded_len().saturating_mul(bytes_per_gaussian);
    check_memory(args, &format!("its {} expanded Gaussians take", grouped(scene.expanded_len())), need)
}

/// Refuses what the machine cannot hold, where that is known.
fn check_memory(args: &ExportArgs, what: &str, need: u64) -> Result<(), CliError> {
    match available_bytes() {
        Some(have) if need > have => {
            let (need, have) = (need >> 20, have >> 20);
            let error = IoError::new(&args.scene, format!("{what} {need} MiB to write, {have} MiB are available"));
            Err(error.advise("keep it as .instgs, or use a machine with more memory").into())
        }
        _ => Ok(()),
    }
}

/// Memory that can be had without swapping; Linux only.
fn available_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}
