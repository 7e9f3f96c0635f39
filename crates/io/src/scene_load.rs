//! Loads and saves a scene, in the format that the file extension names.

use std::path::Path;

use crate::glb::GlbScene;
use crate::ply::PlyCloud;
use crate::sog::SogCloud;
use crate::spz::SpzCloud;
use crate::{IoError, RunFolder, glb, ply, read_bytes, scene_file, scene_write, sog, splat, spz};
use instgs_vk::scene::instanced_scene::InstancedScene;
use instgs_vk::scene::{Gaussians, PixelFilter};

/// A scene loaded from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedScene {
    /// The scene; all parameters are finite.
    pub scene: InstancedScene,
    /// Number of Gaussians of templates, instances' own and background that were dropped because a parameter is not finite (a template
    /// Gaussian counts once for all instances).
    pub dropped_non_finite: usize,
    /// Other notes for the user, one line each.
    pub notes: Vec<String>,
    /// Length of the file in bytes.
    pub file_bytes: u64,
    /// The format that it was read as, by its ending: `instgs`, `ply`, `spz`, `sog`, `splat` or `glb`.
    pub format: String,
}

impl LoadedScene {
    /// All warnings for the user, one line each.
    pub fn warnings(&self) -> Vec<String> {
        let dropped = format!("dropped {} Gaussians with a non-finite parameter", self.dropped_non_finite);
        (self.dropped_non_finite > 0).then_some(dropped).into_iter().chain(self.notes.iter().cloned()).collect()
    }
}

/// The same as [`load_scene`], with the background in an order that is fast to draw ([`InstancedScene::order_background`]).
///
/// # Errors
/// The file cannot be read, its ending is of no format that [`load_scene`] reads, or its content is damaged.
pub fn load_scene_to_draw(path: &Path) -> Result<LoadedScene, IoError> {
    let mut loaded = load_scene(path)?;
    loaded.scene.order_background();
    Ok(loaded)
}

/// Endings of the files that [`load_scene`] reads.
const ENDINGS: [&str; 6] = ["instgs", "ply", "spz", "sog", "splat", "glb"];

/// The error of a folder that is given as a scene: a run's, mostly, whose scene is a file in it.
fn folder_as_scene(folder: &Path) -> IoError {
    let run = RunFolder::new(folder);
    let scene = [run.scene(), run.point_cloud()].into_iter().find(|file| file.is_file());
    let advice = match scene {
        Some(file) => format!("its scene is {}", file.display()),
        None => "name the scene's file".to_owned(),
    };
    IoError::new(folder, "is a folder, and no .sog that is not packed").advise(advice)
}

/// Loads `.instgs`, `.ply`, `.spz`, `.sog` (or the folder of one that is not packed, or its `meta.json`), `.splat` or `.glb`.
/// A template Gaussian is dropped, in all instances, if it or the offset record of any instance is not finite, so that
/// offsets stay aligned with templates.
///
/// # Errors
/// The file cannot be read, or none of its Gaussians is finite. An empty scene is not an error.
pub fn load_scene(path: &Path) -> Result<LoadedScene, IoError> {
    let extension = if sog::is_unpacked(path) { "sog".to_owned() } else { extension(path) };
    if extension != "sog" && path.is_dir() {
        return Err(folder_as_scene(path));
    }
    if !ENDINGS.contains(&extension.as_str()) {
        let what = format!("unknown scene format \".{extension}\"");
        return Err(IoError::new(path, what).advise("scenes are .instgs, .ply, .spz, .sog, .splat or .glb"));
    }
    let (mut scene, mut notes, file_bytes, format) = if sog::is_unpacked(path) {
        let SogCloud { gaussians, antialias, file_bytes } = sog::read_sog(path)?;
        (of_cloud(gaussians, antialias), Vec::new(), file_bytes, extension)
    } else {
        let bytes = read_bytes(path)?;
        // The two bytes of gzip may begin a position of a .splat, whose records have 32 bytes.
        let may_be_splat = extension == "splat" && bytes.len().is_multiple_of(32) && bytes.starts_with(&GZIP);
        let content = format_by_content(&bytes).filter(|_| !may_be_splat).unwrap_or(&extension);
        let (scene, mut notes) = parse(&bytes, path, content)?;
        if content != extension {
            notes.push(format!("has the ending of .{extension}, but the content of .{content}, as which it is read"));
        }
        (scene, notes, bytes.len() as u64, content.to_owned())
    };
    let before = scene.source_len();
    let dropped_non_finite = scene.drop_non_finite();
    if before > 0 && dropped_non_finite == before {
        return Err(IoError::new(path, format!("none of its {before} Gaussians has finite parameters"))
            .advise("its training failed: train it again, or export it anew"));
    }
    let stale = scene.drop_stale_levels();
    if stale > 0 {
        notes.push(format!(
            "{stale} of its levels of detail are of templates that were changed since, and are left out; instgs-vk levels makes new \
             ones"
        ));
    }
    Ok(LoadedScene { scene, dropped_non_finite, notes, file_bytes, format })
}

/// How gzipped files begin.
const GZIP: [u8; 2] = [0x1F, 0x8B];

/// The format that the first bytes of a file tell; `None` for `.splat`, which begins with a position, and for what is none.
fn format_by_content(bytes: &[u8]) -> Option<&'static str> {
    const STARTS: [(&[u8], &str); 5] =
        [(b"ply", "ply"), (&GZIP, "spz"), (b"NGSP", "spz"), (b"glTF", "glb"), (b"PK\x03\x04", "sog")];
    let by_start = STARTS.iter().find(|(start, _)| bytes.starts_with(start)).map(|(_, format)| *format);
    // A safetensors file: the length of its header, which is a JSON object.
    let header = bytes.first_chunk::<8>().map(|length| u64::from_le_bytes(*length));
    let is_tensors = bytes.get(8) == Some(&b'{') && header.is_some_and(|length| length < bytes.len() as u64);
    by_start.or(is_tensors.then_some("instgs"))
}

/// A scene of a cloud whose file says only whether opacities are compensated.
fn of_cloud(cloud: Gaussians, antialias: bool) -> InstancedScene {
    let pixel_filter = PixelFilter { antialias, ..PixelFilter::default() };
    InstancedScene { pixel_filter, ..InstancedScene::from_cloud(cloud) }
}

/// The scene in the bytes of a file of a known format, and notes for the user.
fn parse(bytes: &[u8], path: &Path, extension: &str) -> Result<(InstancedScene, Vec<String>), IoError> {
    Ok(match extension {
        "instgs" => (scene_file::parse_scene_file(bytes, path)?, Vec::new()),
        "spz" => {
            let SpzCloud { gaussians, antialias, notes } = spz::parse_spz(bytes, path)?;
            (of_cloud(gaussians, antialias), notes)
        }
        "sog" => {
            let SogCloud { gaussians, antialias, .. } = sog::parse_sog(bytes, path)?;
            (of_cloud(gaussians, antialias), Vec::new())
        }
        "splat" => (of_cloud(splat::parse_splat(bytes, path)?, false), Vec::new()),
        "glb" => {
            let GlbScene { scene, notes } = glb::parse_glb(bytes, path)?;
            (scene, notes)
        }
        _ => {
            let PlyCloud { gaussians, pixel_filter, notes } = ply::parse_ply(bytes, path)?;
            (InstancedScene { pixel_filter, ..InstancedScene::from_cloud(gaussians) }, notes)
        }
    })
}

/// Saves a scene as `.instgs`. For plain clouds see [`crate::write_ply`], [`crate::write_spz`] and
/// [`crate::write_sog`].
pub fn save_scene(path: &Path, scene: &InstancedScene) -> Result<(), IoError> {
    match extension(path).as_str() {
        "instgs" => scene_write::write_scene_file(path, scene),
        other => Err(IoError::new(path, format!("an instanced scene cannot be saved as \".{other}\""))
            .advise("save it as .instgs")),
    }
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample;
    use instgs_samples::{sample_scene, with_ablations, with_levels};
    use instgs_vk::scene::lod::template_print;

    #[test]
    fn offsets_of_sh_and_shape_follow_their_records() -> Result<(), Box<dyn std::error::Error>> {
        let mut scene = with_ablations();
        let clean = scene.offsets.clone();
        scene.offsets.quats[4][1] = f32::NAN;
        assert_eq!(scene.drop_non_finite(), 1);
        scene.validate()?;
        let kept = [0, 2, 3, 5, 6, 7];
        let want: Vec<_> = kept.iter().flat_map(|&m| clean.sh_rest[8 * m..8 * (m + 1)].to_vec()).collect();
        assert_eq!(scene.offsets.sh_rest, want);
        assert_eq!(scene.offsets.log_scales, kept.map(|m| clean.log_scales[m]));
        assert_eq!(scene.offsets.quats, kept.map(|m| clean.quats[m]));
        Ok(())
    }

    #[test]
    fn levels_of_changed_templates_are_left_out_with_a_note() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.instgs");
        save_scene(&path, &with_levels())?;
        let loaded = load_scene(&path)?;
        assert_eq!((loaded.notes.len(), loaded.scene.fitted_levels.len()), (0, 3));
        // A Gaussian that is not finite is dropped, and with it the levels of its template.
        let mut scene = with_levels();
        scene.templates.opacity_logits[4] = f32::NAN;
        let print = template_print(&scene.templates.range(scene.template_ranges[1]));
        scene.fitted_levels[2].template_print = print;
        save_scene(&path, &scene)?;
        let loaded = load_scene(&path)?;
        assert_eq!((loaded.dropped_non_finite, loaded.scene.fitted_levels.len()), (1, 2));
        assert!(loaded.notes.len() == 1 && loaded.notes[0].starts_with("1 of its levels"), "{:?}", loaded.notes);
        Ok(())
    }

    #[test]
    fn by_extension() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let at = |name: &str| folder.path().join(name);
        let scene = sample_scene();
        save_scene(&at("a.instgs"), &scene)?;
        let loaded = load_scene(&at("a.instgs"))?;
        assert_eq!((loaded.scene, loaded.dropped_non_finite), (scene, 0));
        assert_eq!(loaded.file_bytes, std::fs::metadata(at("a.instgs"))?.len());

        let mut cloud = sample(1, 3);
        cloud.quats[0] = [0.0; 4];
        crate::write_ply(&at("b.PLY"), &cloud, PixelFilter::default())?;
        let loaded = load_scene(&at("b.PLY"))?;
        assert_eq!((loaded.scene.background.len(), loaded.dropped_non_finite), (2, 1));
        cloud.means.iter_mut().for_each(|m| m[0] = f32::NAN);
        crate::write_ply(&at("c.ply"), &cloud, PixelFilter::default())?;
        assert!(load_scene(&at("c.ply")).is_err_and(|e| e.to_string().contains("none of its 3")));
        crate::write_ply(&at("d.ply"), &sample(0, 0), PixelFilter::default())?;
        assert!(load_scene(&at("d.ply"))?.scene.background.is_empty());
        let nothing: [String; 0] = [];
        assert_eq!(
            (load_scene(&at("b.PLY"))?.warnings().len(), load_scene(&at("d.ply"))?.warnings()),
            (1, nothing.into())
        );
        crate::write_ply(&at("e.ply"), &sample(0, 1), PixelFilter { antialias: true, ..PixelFilter::default() })?;
        assert!(load_scene(&at("e.ply"))?.scene.pixel_filter.antialias);
        crate::write_sog(&at("f.sog"), &sample(2, 3), true)?;
        let loaded = load_scene(&at("f.sog"))?;
        assert_eq!((loaded.scene.background.len(), loaded.scene.pixel_filter.antialias), (3, true));
        assert_eq!(loaded.file_bytes, std::fs::metadata(at("f.sog"))?.len());
        assert!(load_scene(&at("x.obj")).is_err() && load_scene(&at("missing.ply")).is_err());
        assert!(save_scene(&at("x.ply"), &sample_scene()).is_err());
        Ok(())
    }
}
