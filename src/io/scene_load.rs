//! Opening and saving a scene by its file name's extension.

use std::collections::BTreeMap;
use std::path::Path;

use crate::io::{IoError, ply, read_bytes, scene_file, scene_write, splat, spz};
use crate::scene::instanced_scene::{InstancedScene, TemplateRange};
use crate::scene::offsets::Offsets;

/// A scene as it came from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedScene {
    /// The scene, with finite parameters only.
    pub scene: InstancedScene,
    /// Gaussians of templates and background that were dropped because a parameter of theirs is not finite (a template
    /// Gaussian counts once, however many instances it had).
    pub dropped_non_finite: usize,
    /// Length of the file.
    pub file_bytes: u64,
}

/// Opens `.instgs`, `.ply`, `.spz` or `.splat`. A template Gaussian is dropped, in all instances, when it or the offset
/// record of any instance is not finite, so that offsets stay aligned with templates. An empty scene is no error; one of
/// which nothing finite remains is.
pub fn load_scene(path: &Path) -> Result<LoadedScene, IoError> {
    let extension = extension(path);
    if !["instgs", "ply", "spz", "splat"].contains(&extension.as_str()) {
        let what = format!("unknown scene format \".{extension}\"");
        return Err(IoError::new(path, what).advise("scenes are .instgs, .ply, .spz or .splat"));
    }
    let bytes = read_bytes(path)?;
    let mut scene = match extension.as_str() {
        "instgs" => scene_file::parse_scene_file(&bytes, path)?,
        "spz" => {
            let cloud = spz::parse_spz(&bytes, path)?;
            InstancedScene { antialias: cloud.antialias, ..InstancedScene::from_cloud(cloud.gaussians) }
        }
        "splat" => InstancedScene::from_cloud(splat::parse_splat(&bytes, path)?),
        _ => InstancedScene::from_cloud(ply::parse_ply(&bytes, path)?),
    };
    let before = scene.templates.len() + scene.background.len();
    let dropped_non_finite = drop_non_finite(&mut scene);
    if before > 0 && dropped_non_finite == before {
        return Err(IoError::new(path, format!("none of its {before} Gaussians has finite parameters")));
    }
    Ok(LoadedScene { scene, dropped_non_finite, file_bytes: bytes.len() as u64 })
}

/// Saves a scene as `.instgs`. Plain clouds have functions of their own: [`crate::io::write_ply`],
/// [`crate::io::write_spz`].
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

/// Drops what is not finite from a consistent scene; returns how many Gaussians went. A finite scene is left as it is.
fn drop_non_finite(scene: &mut InstancedScene) -> usize {
    let dropped_background = scene.background.drop_non_finite();
    let mut keep: Vec<bool> = (0..scene.templates.len()).map(|i| scene.templates.is_finite(i)).collect();
    let offsets = &scene.offsets;
    let finite = |m: usize| {
        offsets.means[m].iter().chain(&offsets.sh_dc[m]).all(|v| v.is_finite()) && offsets.opacity_logits[m].is_finite()
    };
    for instance in &scene.instances {
        let range = scene.template_ranges[instance.template as usize];
        if let Some(first) = instance.first_offset {
            for j in 0..range.count as usize {
                keep[range.first as usize + j] &= finite(first as usize + j);
            }
        }
    }
    let dropped_template = keep.iter().filter(|&&k| !k).count();
    if dropped_template > 0 {
        compact_templates(scene, &keep);
    }
    if dropped_template + dropped_background > 0 {
        // Tensors of other versions that follow these arrays would no longer be aligned with them.
        let follows = |name: &str| ["offset.", "template.", "background."].iter().any(|p| name.starts_with(p));
        scene.foreign_tensors.retain(|name, _| !follows(name));
    }
    dropped_template + dropped_background
}

/// Removes the template Gaussians that are not kept, with their offset records.
fn compact_templates(scene: &mut InstancedScene, keep: &[bool]) {
    let mut kept_before = Vec::with_capacity(keep.len() + 1);
    let mut count = 0u32;
    for &k in keep {
        kept_before.push(count);
        count += u32::from(k);
    }
    kept_before.push(count);
    let mut offsets = Offsets::default();
    // Instances may share a run of records.
    let mut moved = BTreeMap::new();
    for instance in &mut scene.instances {
        let TemplateRange { first: range_first, count } = scene.template_ranges[instance.template as usize];
        let Some(first) = instance.first_offset else { continue };
        let new_first = *moved.entry((first, range_first, count)).or_insert_with(|| {
            let new_first = offsets.len() as u32;
            for j in (0..count as usize).filter(|j| keep[range_first as usize + j]) {
                offsets.means.push(scene.offsets.means[first as usize + j]);
                offsets.sh_dc.push(scene.offsets.sh_dc[first as usize + j]);
                offsets.opacity_logits.push(scene.offsets.opacity_logits[first as usize + j]);
            }
            new_first
        });
        instance.first_offset = Some(new_first);
    }
    scene.offsets = offsets;
    for range in &mut scene.template_ranges {
        let (first, end) = (range.first as usize, (range.first + range.count) as usize);
        *range = TemplateRange { first: kept_before[first], count: kept_before[end] - kept_before[first] };
    }
    scene.templates = scene.templates.filtered(|i| keep[i]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::ply::tests::sample;
    use crate::io::scene_file::tests::sample_scene;

    #[test]
    fn drops_keep_offsets_aligned() -> Result<(), Box<dyn std::error::Error>> {
        let mut scene = sample_scene();
        let clean = scene.clone();
        assert_eq!(drop_non_finite(&mut scene), 0);
        assert_eq!(scene, clean);

        // sample_scene: templates 0..3 and 3..5, instances (0, offsets 0), (1, none), (0, offsets 3), (1, offsets 6).
        scene.templates.means[0][1] = f32::NAN;
        scene.offsets.opacity_logits[4] = f32::INFINITY;
        scene.background.log_scales[1][0] = f32::NAN;
        assert_eq!(drop_non_finite(&mut scene), 3);
        scene.validate()?;
        assert_eq!(scene.template_ranges, [TemplateRange { first: 0, count: 1 }, TemplateRange { first: 1, count: 2 }]);
        assert_eq!(scene.templates.means, clean.templates.means[2..]);
        let firsts: Vec<_> = scene.instances.iter().map(|i| i.first_offset).collect();
        assert_eq!(firsts, [Some(0), None, Some(1), Some(2)]);
        let want: Vec<_> = [2, 5, 6, 7].iter().map(|&m: &usize| clean.offsets.means[m]).collect();
        assert_eq!(scene.offsets.means, want);
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
        crate::io::write_ply(&at("b.PLY"), &cloud)?;
        let loaded = load_scene(&at("b.PLY"))?;
        assert_eq!((loaded.scene.background.len(), loaded.dropped_non_finite), (2, 1));
        cloud.means.iter_mut().for_each(|m| m[0] = f32::NAN);
        crate::io::write_ply(&at("c.ply"), &cloud)?;
        assert!(load_scene(&at("c.ply")).is_err_and(|e| e.to_string().contains("none of its 3")));
        crate::io::write_ply(&at("d.ply"), &sample(0, 0))?;
        assert!(load_scene(&at("d.ply"))?.scene.background.is_empty());
        assert!(load_scene(&at("x.obj")).is_err() && load_scene(&at("missing.ply")).is_err());
        assert!(save_scene(&at("x.ply"), &sample_scene()).is_err());
        Ok(())
    }
}
