//! A trained scene that a run starts from instead of points.

use std::path::Path;

use instgs_io::{IoError, LoadedScene, load_scene};
use instgs_vk::scene::{Gaussians, InstancedScene};

use super::config::TrainConfig;

/// A scene file, read as a plain cloud.
pub struct GivenCloud {
    /// All Gaussians, instances expanded, with the configuration's SH degree; at least one.
    pub cloud: Gaussians,
    /// Length of the file, bytes.
    pub file_bytes: u64,
    /// Warnings for the user, one line each.
    pub warnings: Vec<String>,
}

/// Reads a scene for the configuration.
///
/// # Errors
/// A file that is missing, damaged, of another format, or without Gaussians.
pub fn given_cloud(path: &Path, config: &TrainConfig) -> Result<GivenCloud, IoError> {
    of_scene(path, load_scene(path)?, config)
}

/// The same, but refuses a scene that already has instances.
///
/// # Errors
/// The same errors as [`given_cloud`], and a scene with instances.
pub fn given_plain_cloud(path: &Path, config: &TrainConfig) -> Result<GivenCloud, IoError> {
    let loaded = load_scene(path)?;
    refuse_instances(path, &loaded.scene)?;
    of_scene(path, loaded, config)
}

/// The same of a scene in memory: its cloud and the warnings; `name` is for messages.
///
/// # Errors
/// A scene with instances, or without Gaussians.
pub fn plain_cloud_of(
    scene: &InstancedScene,
    name: &Path,
    config: &TrainConfig,
) -> Result<(Gaussians, Vec<String>), IoError> {
    refuse_instances(name, scene)?;
    cloud_of(name, scene, false, config)
}

fn refuse_instances(path: &Path, scene: &InstancedScene) -> Result<(), IoError> {
    let instances = scene.instances.len();
    if instances == 0 {
        return Ok(());
    }
    let error = IoError::new(path, format!("has {instances} instances already; objects are found in a plain cloud"));
    Err(error.advise("expand them with instgs-vk export --to X.ply, or take the cloud it was made of"))
}

fn of_scene(path: &Path, loaded: LoadedScene, config: &TrainConfig) -> Result<GivenCloud, IoError> {
    let of_file = loaded.warnings().into_iter().map(|what| format!("{}: {what}", path.display()));
    let tells = TELL_COMPENSATION.contains(&loaded.format.as_str());
    let (cloud, of_cloud) = cloud_of(path, &loaded.scene, tells, config)?;
    Ok(GivenCloud { cloud, file_bytes: loaded.file_bytes, warnings: of_file.chain(of_cloud).collect() })
}

/// Formats whose files say that opacities are not compensated; others leave that open.
const TELL_COMPENSATION: [&str; 3] = ["instgs", "spz", "sog"];

/// All Gaussians of a scene with the configuration's SH degree, and warnings. `tells_compensation` is false if its opacities may
/// be compensated although it does not say so.
fn cloud_of(
    path: &Path,
    scene: &InstancedScene,
    tells_compensation: bool,
    config: &TrainConfig,
) -> Result<(Gaussians, Vec<String>), IoError> {
    let mut warnings = Vec::new();
    let mut warn = |what: String| warnings.push(format!("{}: {what}", path.display()));
    let (trained, now) = (scene.pixel_filter, config.pixel_filter());
    match (trained.antialias, now.antialias) {
        (true, false) => warn("was trained with opacity compensation, which is off; see --set antialias=true".into()),
        (false, true) if tells_compensation => {
            warn("was trained without opacity compensation, which is on; see --set antialias=false".into());
        }
        _ => {}
    }
    if trained.dilation_px2 != now.dilation_px2 {
        let (before, now) = (trained.dilation_px2, now.dilation_px2);
        warn(format!("was trained with a dilation of {before} px^2, not {now}; see --set dilation={before}"));
    }
    if scene.near_plane != config.near_plane() {
        let (before, now) = (scene.near_plane.0, config.near);
        warn(format!("was trained with a near plane at {before}, not {now}; see --set near={before}"));
    }
    let mut cloud = scene.flatten_shown();
    if cloud.is_empty() {
        let error = IoError::new(path, "has no Gaussians to start from");
        return Err(error.advise("give a trained scene, or leave it out to start from points"));
    }
    cloud.set_sh_degree(config.sh_degree);
    Ok((cloud, warnings))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ConfigBuilder;
    use instgs_io::{save_scene, write_ply};

    /// Only where the file says so: a .ply without a comment may be of a program that writes none.
    #[test]
    fn both_ways_of_compensation_are_told_apart() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let cloud = Gaussians {
            sh_degree: 0,
            means: vec![[0.0; 3]],
            quats: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-3.0; 3]],
            opacity_logits: vec![0.5],
            sh: vec![[0.1; 3]],
        };
        let mut scene = InstancedScene::from_cloud(cloud.clone());
        for trained in [false, true] {
            scene.pixel_filter.antialias = trained;
            let (own, ply) = (folder.path().join("a.instgs"), folder.path().join("a.ply"));
            save_scene(&own, &scene)?;
            write_ply(&ply, &cloud, scene.pixel_filter)?;
            for now in [false, true] {
                let config = ConfigBuilder::new().set(&format!("antialias={now}"))?.finish()?;
                let advice = format!("see --set antialias={trained}");
                let told = |path: &Path| {
                    let warnings = given_cloud(path, &config)?.warnings;
                    Ok::<_, IoError>(warnings.iter().filter(|text| text.contains(&advice)).count())
                };
                let differs = trained != now;
                assert_eq!((told(&own)?, told(&ply)?), (usize::from(differs), usize::from(differs && trained)));
            }
        }
        Ok(())
    }
}
