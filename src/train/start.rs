//! Where a run begins: the dataset, the first Gaussians, or the newest checkpoint.

use std::path::Path;
use std::sync::Arc;

use crate::gpu::Gpu;
use crate::io::checkpoint;
use crate::io::dataset::{Dataset, Split, read_views};
use crate::io::point_cloud::read_points;
use crate::io::{IoError, View, load_scene};
use crate::scene::gaussians::sh_coefficients;
use crate::scene::{Camera, Gaussians, InstancedScene, PointCloud};

use super::config::{Init, TrainConfig};
use super::device_state::DeviceState;
use super::error::TrainError;
use super::initial::{from_points, random_in_view, scene_extent};
use super::state_file::from_checkpoint;
use super::trainer::TrainJob;

/// Sub-stream of the seed for random starts ("init" in ASCII).
const INIT_STREAM: u64 = 0x696e_6974;

/// A dataset, split, with what training needs to know of it.
pub(super) struct TrainData {
    pub(super) train: Vec<View>,
    pub(super) test: Vec<View>,
    /// Empty if the dataset has none.
    pub(super) points: PointCloud,
    /// Scene extent, scene units.
    pub(super) extent: f64,
    /// Things worth telling, one line each.
    pub(super) warnings: Vec<String>,
}

/// Reads cameras and points of a dataset.
///
/// # Errors
/// A file that is damaged or missing; no training views; no points where `init` asks for them.
pub(super) fn read_data(folder: &Path, needs_points: bool) -> Result<TrainData, TrainError> {
    let dataset = read_views(folder)?;
    let of = |split| -> Vec<View> { Dataset::split(&dataset, split).cloned().collect() };
    let (train, test) = (of(Split::Train), of(Split::Test));
    if train.is_empty() {
        return Err(IoError::new(folder, "has no training views").into());
    }
    let mut warnings = Vec::new();
    let points = match read_points(folder)? {
        Some(loaded) => {
            if loaded.dropped_non_finite > 0 {
                let (path, n) = (loaded.path.display(), loaded.dropped_non_finite);
                warnings.push(format!("{path}: dropped {n} points that are not finite"));
            }
            loaded.points
        }
        None if needs_points => {
            let error = IoError::new(folder, "has no point cloud to start from");
            return Err(error.advise("give a .ply with --init, or --set init=random").into());
        }
        None => PointCloud::default(),
    };
    let cameras: Vec<Camera> = train.iter().map(|v| v.camera.clone()).collect();
    let extent = scene_extent(&cameras, &points);
    Ok(TrainData { train, test, points, extent, warnings })
}

/// The state that a run starts from, and how many steps are behind it.
pub(super) fn first_state(
    gpu: &Arc<Gpu>,
    job: &TrainJob,
    data: &mut TrainData,
    chunk_size: u32,
) -> Result<(DeviceState, u64), TrainError> {
    if job.resume {
        let newest = checkpoint::latest(&job.out.join("checkpoints"))?;
        data.warnings.extend(newest.skipped.iter().map(|e| format!("{e}; an older checkpoint is used")));
        if let Some((path, found)) = newest.found {
            let step = found.step;
            return Ok((from_checkpoint(gpu, found, &path, chunk_size)?, step));
        }
    }
    let cloud = match &job.init {
        Some(path) => init_cloud(path, &job.config, data)?,
        None if job.config.init == Init::Points => from_points(&data.points, job.config.sh_degree),
        None => {
            let cameras: Vec<Camera> = data.train.iter().map(|v| v.camera.clone()).collect();
            let seed = crate::math::rng::Rng::new(job.config.seed).fork(INIT_STREAM).next_u64();
            random_in_view(&cameras, job.config.init_count as usize, seed, job.config.sh_degree)
        }
    };
    let cloud = capped(cloud, job.config.max_gaussians as usize, &mut data.warnings);
    Ok((DeviceState::new(gpu, &InstancedScene::from_cloud(cloud), chunk_size)?, 0))
}

/// A trained scene as a plain cloud of the run's SH degree.
fn init_cloud(path: &Path, config: &TrainConfig, data: &mut TrainData) -> Result<Gaussians, TrainError> {
    let loaded = load_scene(path)?;
    if loaded.dropped_non_finite > 0 {
        let n = loaded.dropped_non_finite;
        data.warnings.push(format!("{}: dropped {n} Gaussians with a non-finite parameter", path.display()));
    }
    let mut cloud = loaded.scene.flatten();
    if cloud.is_empty() {
        return Err(IoError::new(path, "has no Gaussians to start from").into());
    }
    if cloud.sh_degree != config.sh_degree {
        let (have, want) = (cloud.sh_coefficients(), sh_coefficients(config.sh_degree));
        cloud.sh =
            cloud.sh.chunks(have).flat_map(|sh| (0..want).map(|c| sh.get(c).copied().unwrap_or_default())).collect();
        cloud.sh_degree = config.sh_degree;
    }
    Ok(cloud)
}

/// Every k-th Gaussian, so that at most `most` are left.
fn capped(cloud: Gaussians, most: usize, warnings: &mut Vec<String>) -> Gaussians {
    let count = cloud.len();
    if count <= most {
        return cloud;
    }
    warnings.push(format!("the start has {count} Gaussians; {most} of them are kept (max_gaussians)"));
    // Evenly spread: i is kept where i * most / count steps up.
    cloud.filtered(|i| (i + 1) * most / count > i * most / count)
}
