//! What a training leaves: the scene without what nobody sees, its files, and its quality on the test views.

use std::sync::Arc;

use instgs_eval::{EvalReport, Evaluated};
use instgs_io::view_image::camera_at_width;
use instgs_io::{IoError, RunFolder, View, write_cameras, write_ply, write_scene_file};
use instgs_vk::gpu::Gpu;
use instgs_vk::render::Renderer;
use instgs_vk::scene::{Camera, InstancedScene};

use super::config::{Method, TrainConfig};
use super::error::TrainError;
use super::observer::{TrainMessage, TrainObserver};
use super::trainer::TrainJob;
use super::view_pictures::evaluate_test_views;

/// Writes the trained scene, from which `pruned` Gaussians were removed as transparent. Returns the length in bytes of the file
/// that counts as the result.
pub(super) fn write_scene(job: &TrainJob, scene: &InstancedScene, pruned: usize, done: u64) -> Result<u64, TrainError> {
    if scene.expanded_len() == 0 {
        return Err(match pruned {
            0 => TrainError::NothingLeft { steps: done },
            _ => TrainError::AllPruned { steps: done, opacity: job.config.joint.prune_opacity },
        });
    }
    let folder = job.folder();
    let mut result = folder.scene();
    write_scene_file(&result, scene)?;
    if job.config.method == Method::Gaussians {
        result = folder.point_cloud();
        write_ply(&result, &scene.background, scene.pixel_filter)?;
    }
    let bytes = std::fs::metadata(&result).map_err(|e| IoError::new(&result, format!("cannot be read: {e}")))?.len();
    Ok(bytes)
}

/// The cameras of views at the size that is trained at.
pub fn cameras_at_training_size(views: &[View], config: &TrainConfig) -> Vec<Camera> {
    let width = (config.width > 0).then_some(config.width);
    views.iter().map(|view| camera_at_width(&view.camera, width)).collect()
}

/// Writes the cameras of the training views beside the scene: a web page begins at the first of them. Where objects were found
/// their labels count by the file that is there, and it stays.
pub(super) fn write_training_cameras(
    folder: &RunFolder,
    train: &[View],
    config: &TrainConfig,
) -> Result<(), TrainError> {
    if !folder.labels().is_file() {
        write_cameras(&folder.cameras(), &cameras_at_training_size(train, config))?;
    }
    Ok(())
}

/// Quality of the trained scene on the test views; `None` without test views.
pub(super) fn evaluate_at_end(
    gpu: &Arc<Gpu>,
    scene: &InstancedScene,
    test: &[View],
    config: &TrainConfig,
    observer: &mut dyn TrainObserver,
) -> Result<Option<EvalReport>, TrainError> {
    if test.is_empty() {
        return Ok(None);
    }
    let mut renderer = Renderer::new(gpu)?;
    let device_scene = renderer.upload(scene)?;
    let mut tell = |view: Evaluated<'_>| observer.notify(TrainMessage::TestView(&view));
    evaluate_test_views(&mut renderer, &device_scene, test, config, &mut tell).map(Some)
}

/// Blending skips an alpha below this.
const LOWEST_DRAWN_OPACITY: f64 = 1.0 / 255.0;

/// Removes non-finite Gaussians and those that no instance shows, and makes those that one shows its own; returns how many
/// Gaussians were removed for each reason.
pub(super) fn cleaned(scene: &mut InstancedScene, config: &TrainConfig) -> (usize, usize) {
    let dropped = scene.drop_non_finite();
    let prune = config.method == Method::Instanced && config.joint.prune_opacity > 0.0;
    let mut pruned = 0;
    if prune {
        pruned = scene.prune_transparent(config.joint.prune_opacity);
        scene.give_to_single_users(config.joint.prune_opacity.min(LOWEST_DRAWN_OPACITY));
    }
    if scene.own.is_empty() {
        scene.own_ranges.clear();
    }
    scene.recentre_offsets();
    (dropped, pruned)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use instgs_io::{Split, read_cameras};

    #[test]
    fn the_views_of_a_training_lie_beside_its_scene() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let run = RunFolder::new(folder.path());
        let view = |name: &str| View {
            camera: Camera::look_at(name, DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 1.0, (40, 20)),
            image_path: name.into(),
            split: Split::Train,
            distortion: None,
            mask_path: None,
        };
        let config = TrainConfig { width: 10, ..TrainConfig::default() };
        write_training_cameras(&run, &[view("b"), view("a")], &config)?;
        let written = read_cameras(&run.cameras())?;
        let sizes = written.iter().map(|camera| (&*camera.name, camera.width, camera.height));
        assert_eq!(sizes.collect::<Vec<_>>(), [("b", 10, 5), ("a", 10, 5)]);
        // A training over another data set goes on; labels count by the views of before.
        std::fs::write(run.labels(), "")?;
        write_training_cameras(&run, &[view("c")], &config)?;
        assert_eq!(read_cameras(&run.cameras())?, written);
        std::fs::remove_file(run.labels())?;
        write_training_cameras(&run, &[view("c")], &config)?;
        assert_eq!(read_cameras(&run.cameras())?.len(), 1);
        Ok(())
    }
}
