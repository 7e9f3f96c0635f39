//! A trained scene that a run starts from instead of points.

use std::path::Path;

use instgs_io::{IoError, LoadedScene, load_scene};
use instgs_vk::scene::Gaussians;

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
    let instances = loaded.scene.instances.len();
    if instances > 0 {
        let error =
            IoError::new(path, format!("has {instances} instances already; objects are found in a plain cloud"));
        return Err(error.advise("expand them with instgs-vk export --to X.ply, or take the cloud it was made of"));
    }
    of_scene(path, loaded, config)
}

fn of_scene(path: &Path, loaded: LoadedScene, config: &TrainConfig) -> Result<GivenCloud, IoError> {
    let mut warnings = Vec::new();
    let mut warn = |what: String| warnings.push(format!("{}: {what}", path.display()));
    loaded.warnings().into_iter().for_each(&mut warn);
    let (trained, now) = (loaded.scene.pixel_filter, config.pixel_filter());
    if trained.antialias && !now.antialias {
        warn("was trained with opacity compensation, which is off; see --set antialias=true".into());
    }
    if trained.dilation_px2 != now.dilation_px2 {
        let (before, now) = (trained.dilation_px2, now.dilation_px2);
        warn(format!("was trained with a dilation of {before} px^2, not {now}; see --set dilation={before}"));
    }
    let mut cloud = loaded.scene.flatten();
    if cloud.is_empty() {
        return Err(IoError::new(path, "has no Gaussians to start from"));
    }
    cloud.set_sh_degree(config.sh_degree);
    Ok(GivenCloud { cloud, file_bytes: loaded.file_bytes, warnings })
}
