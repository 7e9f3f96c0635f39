//! `instgs-vk export`: a scene in another file format.

use std::path::PathBuf;

use clap::Args;

use super::args::open_scene;
use super::error::CliError;
use super::printer::Printer;
use super::table::grouped;
use crate::io::{IoError, save_scene, write_ply, write_spz};
use crate::scene::InstancedScene;
use crate::scene::gaussians::sh_coefficients;

/// Writes a scene as .ply or .spz (every instance expanded into Gaussians of its own), or as .instgs.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk export --scene room.instgs --to room.ply\n  \
    instgs-vk export --scene room.ply --to room.spz")]
pub(super) struct ExportArgs {
    /// Scene: .instgs, .ply, .spz or .splat
    #[arg(long, value_name = "S")]
    scene: PathBuf,
    /// File to write: .ply, .spz or .instgs
    #[arg(long, value_name = "X.(ply|spz|instgs)")]
    to: PathBuf,
    /// Report as JSON
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(serde::Serialize)]
struct Exported {
    scene: String,
    to: String,
    /// In the new file: expanded, or of templates and background for .instgs.
    gaussians: u64,
    flattened_instances: usize,
    bytes: u64,
}

#[derive(Clone, Copy)]
enum Target {
    Ply,
    Spz,
    Instgs,
}

pub(super) fn run(args: &ExportArgs, printer: &Printer) -> Result<(), CliError> {
    let to = args.to.as_path();
    let target = target(args)?;
    let scene = open_scene(&args.scene, printer)?.scene;
    let gaussians = match target {
        Target::Instgs => {
            save_scene(to, &scene)?;
            (scene.templates.len() + scene.background.len()) as u64
        }
        Target::Ply | Target::Spz => {
            check_memory(args, &scene)?;
            let cloud = scene.flatten();
            match target {
                Target::Spz => write_spz(to, &cloud, scene.antialias)?,
                _ => write_ply(to, &cloud)?,
            }
            cloud.len() as u64
        }
    };
    if matches!(target, Target::Ply) && scene.antialias {
        printer.warning(format_args!(
            "{}: .ply has no place for the scene's antialias flag; render it with --antialias",
            to.display()
        ));
    }
    let flattened_instances = if matches!(target, Target::Instgs) { 0 } else { scene.instances.len() };
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

fn target(args: &ExportArgs) -> Result<Target, CliError> {
    let ending = args.to.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let fail = |what: String| Err(IoError::new(&args.to, what).advise("export to .ply, .spz or .instgs").into());
    match ending.as_str() {
        "ply" => Ok(Target::Ply),
        "spz" => Ok(Target::Spz),
        "instgs" => Ok(Target::Instgs),
        "glb" => fail("export to .glb is not there yet".into()),
        other => fail(format!("unknown format \".{other}\"")),
    }
}

/// Flattening holds the cloud and the file's bytes at once: refuse what the machine cannot hold, where that is known.
fn check_memory(args: &ExportArgs, scene: &InstancedScene) -> Result<(), CliError> {
    let bytes_per_gaussian = 2 * 4 * (14 + 3 * sh_coefficients(scene.sh_degree()) as u64);
    let need = scene.expanded_len().saturating_mul(bytes_per_gaussian);
    match available_bytes() {
        Some(have) if need > have => {
            let count = grouped(scene.expanded_len());
            let (need, have) = (need >> 20, have >> 20);
            let what = format!("its {count} expanded Gaussians take {need} MiB to write, {have} MiB are available");
            let error = IoError::new(&args.scene, what).advise("keep it as .instgs, or use a machine with more memory");
            Err(error.into())
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
