//! Files beside the scene: cameras, camera paths, screenshots.

use std::path::{Path, PathBuf};

use super::Live;
use crate::hud::Hud;
use crate::navigation::Navigator;
use crate::recording::{PATH_FPS, Recording};
use instgs_io::{read_cameras, write_cameras};
use instgs_vk::scene::Camera;

/// Cameras to step through.
#[derive(Default)]
pub(super) struct CameraList {
    pub(super) list: Vec<Camera>,
    /// Index of the camera that was shown last.
    pub(super) at: Option<usize>,
}

impl Live {
    /// Keeps the camera, in memory and in a camera file beside the scene.
    pub(super) fn keep_camera(&mut self) {
        let path = cameras_path(&self.session.path);
        if let (true, true, Err(error)) = (self.camera.kept.list.is_empty(), path.exists(), read_cameras(&path)) {
            self.hud.message = Some(format!("{error}; the file is not overwritten"));
            return;
        }
        let mut camera = self.camera.navigator.camera(self.screen.swapchain.size_px());
        camera.name = format!("{:03}", self.camera.kept.list.len());
        self.camera.kept.list.push(camera);
        self.camera.kept.at = None;
        self.hud.message = Some(match write_cameras(&path, &self.camera.kept.list) {
            Ok(()) => format!("camera {} saved to {}", self.camera.kept.list.len(), path.display()),
            Err(error) => error.to_string(),
        });
    }

    /// Starts recording the camera path, or ends it and writes the path beside the scene.
    pub(super) fn record_path(&mut self) {
        let Some(recording) = self.camera.recording.take() else {
            self.camera.recording = Some(Recording::default());
            self.hud.message = Some("recording the camera path: P stops".into());
            return;
        };
        let (path, cameras) = (self.session.free_name("path.json"), recording.cameras());
        self.hud.message = Some(match write_cameras(&path, &cameras) {
            Ok(()) => format!(
                "{} cameras, {PATH_FPS} per second: instgs-vk render --camera {}",
                cameras.len(),
                path.display()
            ),
            Err(error) => error.to_string(),
        });
    }

    /// Writes the last frame beside the scene.
    pub(super) fn write_picture(&mut self) {
        let path = self.session.free_name("png");
        self.hud.message = Some(match self.session.viewer.screenshot(&path) {
            Ok(()) => path.display().to_string(),
            Err(error) => error.to_string(),
        });
    }
}

/// Shows the next or previous of a list of cameras, cyclically; from none to the first or the last.
pub(super) fn step(cameras: &mut CameraList, by: isize, navigator: &mut Navigator, hud: &mut Hud) {
    let CameraList { list, at } = cameras;
    if list.is_empty() {
        hud.message = Some("there are no cameras to step through: start with --data DIR, or keep one with C".into());
        return;
    }
    let next = stepped(*at, by, list.len());
    let camera = &list[next];
    navigator.stand_at(camera);
    hud.message = Some(format!("camera {} of {}: {}", next + 1, list.len(), camera.name));
    *at = Some(next);
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
