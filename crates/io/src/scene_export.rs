//! Exports a scene in the format that the file extension names.

use std::path::Path;

use glam::DVec3;

use crate::host_memory::available_bytes;
use crate::run_folder::{self, ends_in_separator};
use crate::spz::Clamped;
use crate::{IoError, Pack, PageOptions, SpzLoss, glb, ply, scene_write, sog, spz, usd, write_page};
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::instanced_scene::InstancedScene;

/// A file format for scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// `.ply`: every instance expanded into Gaussians of its own.
    Ply,
    /// `.spz`: expanded like `Ply`, but quantised and compressed.
    Spz,
    /// `.sog`: expanded like `Ply`, but quantised, as images in an archive.
    Sog,
    /// A folder of `.sog` files, one for each template and one for the background, and `scene_graph.json`, which places the
    /// instances: what they have for themselves is left out.
    SogFolder,
    /// `.glb`: instances are nodes that share their template's data.
    Glb,
    /// `.glb` of one mesh: expanded like `Ply`, for viewers that put whole meshes in order.
    GlbOneMesh,
    /// `.usda`: instances are prims; those without anything of their own are references to their template.
    Usda,
    /// `.usdc`: the same as `Usda`, as a binary file.
    Usdc,
    /// `.instgs`: not expanded, with packed values.
    Instgs(Pack),
    /// `.html`: a page that holds the `.instgs` file with packed values and draws it.
    Page(Pack),
}

impl ExportFormat {
    /// The format for a file name, or for that of a folder, which ends in a slash; `pack` is only valid for `.instgs` and
    /// `.html`.
    ///
    /// # Errors
    /// An unknown extension, or a pack for another format.
    pub fn of(path: &Path, pack: Option<Pack>) -> Result<Self, IoError> {
        let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        match ending.as_str() {
            _ if ends_in_separator(path) && pack.is_none() => Ok(Self::SogFolder),
            _ if ends_in_separator(path) => {
                Err(IoError::new(path, "--pack is for .instgs and .html files, and this is a folder")
                    .advise("leave it out, or name a file"))
            }
            "instgs" => Ok(Self::Instgs(pack.unwrap_or(Pack::F32))),
            // A page is to be sent to people.
            "html" => Ok(Self::Page(pack.unwrap_or(Pack::Small))),
            _ if pack.is_some() => Err(IoError::new(path, "--pack is for .instgs and .html files")
                .advise("leave it out, or export to .instgs or .html")),
            "ply" => Ok(Self::Ply),
            "spz" => Ok(Self::Spz),
            "sog" => Ok(Self::Sog),
            "glb" => Ok(Self::Glb),
            "usda" => Ok(Self::Usda),
            "usdc" => Ok(Self::Usdc),
            other => Err(IoError::new(path, format!("unknown format \".{other}\"")).advise(
                "export to .ply, .spz, .sog, .glb, .usda, .usdc, .instgs or .html, or to a folder, with a / at its end",
            )),
        }
    }

    /// Makes the folder that the export will lie in, or that it is, before the work.
    ///
    /// # Errors
    /// A file is wanted and the path is a folder's; the system refuses.
    pub fn create_folder(self, to: &Path) -> Result<(), IoError> {
        if self == Self::SogFolder { run_folder::create(to) } else { run_folder::create_for(to) }
    }

    /// The format with everything in one mesh, for a file name.
    ///
    /// # Errors
    /// A format without meshes.
    pub fn in_one_mesh(self, path: &Path) -> Result<Self, IoError> {
        match self {
            Self::Glb | Self::GlbOneMesh => Ok(Self::GlbOneMesh),
            _ => Err(IoError::new(path, "--one-mesh is for .glb files").advise("leave it out, or export to .glb")),
        }
    }

    /// True if the file says which way is up.
    pub fn has_up(self) -> bool {
        matches!(self, Self::Glb | Self::GlbOneMesh | Self::Usda | Self::Usdc | Self::Page(_))
    }

    /// True if the file stores every instance's Gaussians separately.
    pub fn is_expanded(self) -> bool {
        matches!(self, Self::Ply | Self::Spz | Self::Sog | Self::GlbOneMesh)
    }
}

/// What [`export_scene`] wrote.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExportedScene {
    /// Number of Gaussians in the file.
    pub gaussians: u64,
    /// Length of all files that were written into a folder, bytes; 0 if it is one file.
    pub folder_bytes: u64,
    /// What an `.spz` file could not hold.
    pub spz_loss: SpzLoss,
    /// Gaussians that `.sog` files hold elsewhere, by more than their own size.
    pub sog_moved: Clamped,
}

/// Writes a scene. `up` is the scene's direction that becomes +y of glTF and USD, and points up in a page.
///
/// # Errors
/// The file cannot be written, or there is not enough memory.
pub fn export_scene(
    to: &Path,
    scene: &InstancedScene,
    format: ExportFormat,
    up: DVec3,
) -> Result<ExportedScene, IoError> {
    let mut exported = ExportedScene { gaussians: scene.source_len() as u64, ..ExportedScene::default() };
    match format {
        ExportFormat::Instgs(pack) => scene_write::write_scene_file_packed(to, scene, pack)?,
        ExportFormat::Page(pack) => {
            write_page(to, scene, &PageOptions { pack, small: None, camera: None, up })?;
        }
        ExportFormat::SogFolder => {
            let written = sog::write_sog_folder(to, scene)?;
            (exported.gaussians, exported.folder_bytes) = (written.gaussians, written.bytes);
            exported.sog_moved = written.moved;
        }
        ExportFormat::Glb => {
            check_memory(to, "its Gaussians take", glb::glb_data_bytes(scene))?;
            glb::write_glb(to, scene, up)?;
            exported.gaussians -= unused_gaussians(scene);
        }
        ExportFormat::Usda | ExportFormat::Usdc => {
            check_expanded_memory(to, scene)?;
            exported.gaussians = scene.expanded_len();
            let write = if format == ExportFormat::Usda { usd::write_usda } else { usd::write_usdc };
            write(to, scene, up)?;
        }
        ExportFormat::Ply | ExportFormat::Spz | ExportFormat::Sog | ExportFormat::GlbOneMesh => {
            check_expanded_memory(to, scene)?;
            let cloud = scene.flatten_shown();
            exported.gaussians = cloud.len() as u64;
            match format {
                ExportFormat::Spz => {
                    exported.spz_loss = spz::write_spz(to, &cloud, scene.pixel_filter.antialias)?;
                }
                ExportFormat::Sog => {
                    exported.sog_moved = sog::write_sog(to, &cloud, scene.pixel_filter.antialias)?.moved;
                }
                ExportFormat::GlbOneMesh => glb::write_glb(to, &InstancedScene::from_cloud(cloud), up)?,
                _ => ply::write_ply(to, &cloud, scene.pixel_filter)?,
            }
        }
    }
    Ok(exported)
}

/// Number of Gaussians of templates that no instance uses.
fn unused_gaussians(scene: &InstancedScene) -> u64 {
    let mut is_used = vec![false; scene.templates.len()];
    for instance in &scene.instances {
        is_used[scene.template_ranges[instance.template as usize].indices()].fill(true);
    }
    is_used.iter().filter(|used| !**used).count() as u64
}

/// Checks memory for flattening, which holds the cloud and the file's bytes at once.
fn check_expanded_memory(to: &Path, scene: &InstancedScene) -> Result<(), IoError> {
    let bytes_per_gaussian = 2 * 4 * (14 + 3 * sh_coefficients(scene.sh_degree()) as u64);
    let count = scene.expanded_len();
    check_memory(to, &format!("its {count} expanded Gaussians take"), count.saturating_mul(bytes_per_gaussian))
}

/// Returns an error if `need` bytes exceed the available memory, if that is known.
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

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample_scene;

    #[test]
    fn a_glb_counts_what_it_holds() -> Result<(), IoError> {
        let folder = tempfile::tempdir().map_err(|e| IoError::os(Path::new("."), "no folder", &e))?;
        let to = folder.path().join("a.glb");
        let mut scene = sample_scene();
        let held = |scene: &InstancedScene| -> Result<(u64, Vec<String>), IoError> {
            let exported = export_scene(&to, scene, ExportFormat::Glb, DVec3::Y)?;
            Ok((exported.gaussians, exported.notes(&to, scene, ExportFormat::Glb)))
        };
        let (all, notes) = held(&scene)?;
        let left_out = "no instance uses are left out";
        assert!(all == scene.source_len() as u64 && !notes.iter().any(|note| note.contains(left_out)), "{notes:?}");
        // Without instances of the last template; another unused one has the Gaussians of the first.
        let last = scene.template_ranges.len() as u32 - 1;
        let unused = u64::from(scene.template_ranges[last as usize].count);
        let stays: Vec<bool> = scene.instances.iter().map(|instance| instance.template != last).collect();
        let mut stay = stays.iter();
        scene.instances.retain(|_| *stay.next().unwrap_or(&true));
        (scene.own_ranges, scene.color_from_template, scene.groups) = Default::default();
        scene.own = scene.own.filtered(|_| false);
        scene.template_ranges.push(scene.template_ranges[0]);
        let (all, notes) = held(&scene)?;
        assert_eq!(all, scene.source_len() as u64 - unused);
        assert!(notes.iter().any(|note| note.contains(left_out)), "{notes:?}");
        Ok(())
    }

    #[test]
    fn a_name_that_ends_in_a_slash_is_that_of_a_folder() {
        for name in ["parts/", "a.instgs/", "a.html/", "a.sog/"] {
            assert_eq!(ExportFormat::of(Path::new(name), None).ok(), Some(ExportFormat::SogFolder), "{name}");
            let packed = ExportFormat::of(Path::new(name), Some(Pack::F16)).map_err(|e| e.to_string());
            assert!(packed.is_err_and(|text| text.contains("--pack") && text.contains("folder")), "{name}");
        }
        assert_eq!(ExportFormat::of(Path::new("a.instgs"), None).ok(), Some(ExportFormat::Instgs(Pack::F32)));
    }

    #[test]
    fn one_mesh_holds_every_instance_expanded() -> Result<(), IoError> {
        let folder = tempfile::tempdir().map_err(|e| IoError::os(Path::new("."), "no folder", &e))?;
        let scene = sample_scene();
        let to = folder.path().join("a.glb");
        let format = ExportFormat::of(&to, None)?.in_one_mesh(&to)?;
        assert!(format.is_expanded() && format.has_up());
        let exported = export_scene(&to, &scene, format, DVec3::Y)?;
        let read = glb::read_glb(&to)?.scene;
        assert_eq!(exported.gaussians, scene.expanded_len());
        assert_eq!((read.instances.len(), read.background.len() as u64), (0, scene.expanded_len()));
        let ply = Path::new("a.ply");
        let refused = ExportFormat::of(ply, None)?.in_one_mesh(ply).map_err(|e| e.to_string());
        assert_eq!(refused, Err("a.ply: --one-mesh is for .glb files; leave it out, or export to .glb".into()));
        Ok(())
    }
}
