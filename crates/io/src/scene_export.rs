//! Writing a scene in the format that a file name's ending names.

use std::path::Path;

use glam::DVec3;

use crate::host_memory::available_bytes;
use crate::{IoError, Pack, glb, ply, scene_write, spz};
use crate::scene::gaussians::sh_coefficients;
use crate::scene::instanced_scene::InstancedScene;

/// A file format for scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// Every instance expanded into Gaussians of its own.
    Ply,
    /// As `Ply`, smaller.
    Spz,
    /// Instances stay nodes that share their template's data.
    Glb,
    /// As it is, its numbers packed.
    Instgs(Pack),
}

impl ExportFormat {
    /// The format of a file; `pack` is for `.instgs` alone.
    ///
    /// # Errors
    /// An unknown ending, or a pack for another format.
    pub fn of(path: &Path, pack: Option<Pack>) -> Result<Self, IoError> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match ending.as_str() {
            "instgs" => Ok(Self::Instgs(pack.unwrap_or(Pack::F32))),
            _ if pack.is_some() => {
                Err(IoError::new(path, "--pack is for .instgs files").advise("leave it out, or export to .instgs"))
            }
            "ply" => Ok(Self::Ply),
            "spz" => Ok(Self::Spz),
            "glb" => Ok(Self::Glb),
            other => Err(IoError::new(path, format!("unknown format \".{other}\""))
                .advise("export to .ply, .spz, .glb or .instgs")),
        }
    }

    /// True if the file holds every instance's Gaussians.
    pub fn is_expanded(self) -> bool {
        matches!(self, Self::Ply | Self::Spz)
    }
}

/// Writes a scene; returns how many Gaussians the file holds. `up` is the scene's direction that becomes glTF's +y.
///
/// # Errors
/// The file cannot be written, or the memory that this takes is not there.
pub fn export_scene(to: &Path, scene: &InstancedScene, format: ExportFormat, up: DVec3) -> Result<u64, IoError> {
    let stored = (scene.templates.len() + scene.background.len()) as u64;
    match format {
        ExportFormat::Instgs(pack) => scene_write::write_scene_file_packed(to, scene, pack)?,
        ExportFormat::Glb => {
            check_memory(to, "its Gaussians take", glb::glb_data_bytes(scene))?;
            glb::write_glb(to, scene, up)?;
        }
        ExportFormat::Ply | ExportFormat::Spz => {
            check_expanded_memory(to, scene)?;
            let cloud = scene.flatten();
            match format {
                ExportFormat::Spz => spz::write_spz(to, &cloud, scene.antialias)?,
                _ => ply::write_ply(to, &cloud, scene.antialias)?,
            }
            return Ok(cloud.len() as u64);
        }
    }
    Ok(stored)
}

/// Flattening holds the cloud and the file's bytes at once.
fn check_expanded_memory(to: &Path, scene: &InstancedScene) -> Result<(), IoError> {
    let bytes_per_gaussian = 2 * 4 * (14 + 3 * sh_coefficients(scene.sh_degree()) as u64);
    let count = scene.expanded_len();
    check_memory(to, &format!("its {count} expanded Gaussians take"), count.saturating_mul(bytes_per_gaussian))
}

/// Refuses what the machine cannot hold, where that is known.
fn check_memory(to: &Path, what: &str, need: u64) -> Result<(), IoError> {
    match available_bytes() {
        Some(have) if need > have => {
            let (need, have) = (need >> 20, have >> 20);
            let error = IoError::new(to, format!("{what} {need} MiB to write, {have} MiB are available"));
            Err(error.advise("keep it as .instgs, or use a machine with more memory"))
        }
        _ => Ok(()),
    }
}
