//! Files beside the scene: cameras, camera paths, screenshots.

use std::path::{Path, PathBuf};

use super::Live;
use crate::hud::Hud;
use crate::io::{read_cameras, write_cameras};
use crate::navigation::Navigator;
use crate::recording::{PATH_FPS, Recording};
use crate::scene::Camera;

/// Cameras to step through.
#[derive(Default)]
pub(super) struct CameraList {
    pub(super) cameras: Vec<Camera>,
    /// Index of the camera that was shown last.
    pub(super) at: Option<usize>,
}

impl Live {
    /// Keeps the camera, in memory and in a camera file beside the scene.
    pub(super) fn keep_camera(&mut self) {
        let path = cameras_path(&self.path);
        if let (true, true, Err(error)) = (self.kept.cameras.is_empty(), path.exists(), read_cameras(&path)) {
            self.hud.message = Some(format!("{error}; the file is not overwritten"));
            return;
        }
        let mut camera = self.navigator.camera(self.swapchain.size_px());
        camera.name = format!("{:03}", self.kept.cameras.len());
        self.kept.cameras.push(camera);
        self.kept.at = None;
        self.hud.message = Some(match write_cameras(&path, &self.kept.cameras) {
            Ok(()) => format!("camera {} saved to {}", self.kept.cameras.len(), path.display()),
            Err(error) => error.to_string(),
        });
    }

    /// Starts recording the camera path, or ends it and writes the path beside the scene.
    pub(super) fn record_path(&mut self) {
        let Some(recording) = self.recording.take() else {
            self.recording = Some(Recording::default());
            self.hud.message = Some("recording the camera path: P stops".into());
            return;
        };
        let (path, cameras) = (self.free_name("path.json"), recording.cameras());
        self.hud.message = Some(match write_cameras(&path, &cameras) {
            Ok(()) => format!(
                "{} cameras, {PATH_FPS} per second: instgs-vk render --camera {}",
                cameras.len(),
                path.display()
            ),
            Err(error) => error.to_string(),
        });
    }

    /// The first unused file name beside the scene with this extension.
    pub(super) fn free_name(&self, ending: &str) -> PathBuf {
        let mut names = (0..).map(|n: u32| self.path.with_extension(format!("{n:03}.{ending}")));
        names.find(|path| !path.exists()).unwrap_or_default()
    }

    /// Writes the last frame beside the scene.
    pub(super) fn write_picture(&mut self) {
        let path = self.free_name("png");
        self.hud.message = Some(match self.viewer.screenshot(&path) {
            Ok(()) => path.display().to_string(),
            Err(error) => error.to_string(),
        });
    }
}

/// Shows the next or previous of a list of cameras, cyclically; from none to the first or the last.
pub(super) fn step(list: &mut CameraList, by: isize, navigator: &mut Navigator, hud: &mut Hud) {
    let cameras = &list.cameras;
    if cameras.is_empty() {
        hud.message = Some("there are no cameras to step through: start with --data DIR, or keep one with C".into());
        return;
    }
    let next = stepped(list.at, by, cameras.len());
    let camera = &cameras[next];
    navigator.stand_at(camera);
    hud.message = Some(format!("camera {} of {}: {}", next + 1, cameras.len(), camera.name));
    list.at = Some(next);
}

/// The index `by` places from `at`, modulo `count`; from `None` forward the first, backward the last.
fn stepped(at: Option<usize>, by: isize, count: usize) -> usize {
    let from = at.map_or(if by > 0 { -1 } else { 0 }, |at| at as isize);
    (from + by).rem_euclid(count as isize) as usize
}

/// The file of a scene's kept cameras; `render --camera` reads it, too.
fn cameras_path(scene: &Path) -> PathBuf {
    scene.with_extension("cameras.json")
}

/// Cameras that were kept earlier; none if there is no such file or it cannot be parsed.
pub(super) fn kept_cameras(scene: &Path) -> Vec<Camera> {
    read_cameras(&cameras_path(scene)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::stepped;

    #[test]
    fn back_and_forth_is_where_one_was() {
        assert_eq!((stepped(None, 1, 3), stepped(None, -1, 3)), (0, 2));
        assert_eq!((stepped(Some(0), 1, 3), stepped(Some(2), 1, 3), stepped(Some(0), -1, 3)), (1, 0, 2));
        assert_eq!(stepped(Some(stepped(Some(1), 1, 3)), -1, 3), 1);
    }
}
