//! Files beside the scene: cameras, camera paths, screenshots.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::Live;
use super::leaving::is_same_file;
use crate::actions::Action;
use crate::error::PlayerError;
use crate::hud::Hud;
use crate::navigation::Navigator;
use crate::recording::{PATH_FPS, Recording};
use crate::texts;
use instgs_io::{IoError, read_cameras, remove_if_there, write_cameras};
use instgs_vk::scene::edit::{Footprint, footprint, instance_centres};
use instgs_vk::scene::{Camera, InstancedScene};

/// Height of the small picture of a kept camera, pixels.
const THUMBNAIL_PX: u32 = 108;

/// Cameras to step through.
#[derive(Default)]
pub(super) struct CameraList {
    pub(super) list: Vec<Camera>,
    /// Index of the camera that was shown last.
    pub(super) at: Option<usize>,
}

impl Live {
    /// Keeps the camera, in memory and in a camera file beside the scene.
    pub(super) fn keep_camera(&mut self) -> Result<(), PlayerError> {
        let path = cameras_path(&self.session.path);
        if let (true, true, Err(error)) = (self.camera.kept.list.is_empty(), path.exists(), read_cameras(&path)) {
            self.hud.message = Some(texts::not_overwritten(&error));
            return Ok(());
        }
        let mut camera = self.camera.navigator.camera(self.screen.swapchain.size_px());
        camera.name = unused_name(&self.camera.kept.list);
        let thumbnail = match self.thumbnail(&camera.name) {
            Err(error) if error.is_lost() => return Err(error),
            // There is no memory for the picture, but the camera needs none.
            thumbnail => thumbnail.unwrap_or_default(),
        };
        self.hud.cameras.thumbnails.resize(self.camera.kept.list.len(), None);
        self.hud.cameras.thumbnails.push(thumbnail);
        self.camera.kept.list.push(camera);
        self.camera.kept.at = None;
        self.hud.message = Some(match write_cameras(&path, &self.camera.kept.list) {
            Ok(()) => texts::camera_saved(self.camera.kept.list.len(), &path),
            Err(error) => error.to_string(),
        });
        Ok(())
    }

    /// The last frame as a small picture; none before the first.
    fn thumbnail(&mut self, name: &str) -> Result<Option<egui::TextureHandle>, PlayerError> {
        let Some([width, height]) = self.session.viewer.size_px() else { return Ok(None) };
        let rgb = self.session.viewer.rgb8()?;
        let step = height.div_ceil(THUMBNAIL_PX).max(1);
        let size = [width / step, height / step].map(|side| side.max(1) as usize);
        let pixel = |k: usize| {
            let (x, y) = (k % size[0] * step as usize, k / size[0] * step as usize);
            let at = 3 * (y * width as usize + x);
            egui::Color32::from_rgb(rgb[at], rgb[at + 1], rgb[at + 2])
        };
        let pixels = (0..size[0] * size[1]).map(pixel).collect();
        let image = egui::ColorImage::new(size, pixels);
        Ok(Some(self.screen.ui.egui_ctx().load_texture(name, image, egui::TextureOptions::LINEAR)))
    }

    /// Carries out an action on the camera or on kept cameras.
    pub(super) fn act_on_camera(&mut self, action: &Action) -> Result<(), PlayerError> {
        match action {
            Action::Frame => self.frame_chosen(),
            Action::LookAlong(along) => {
                let navigator = &mut self.camera.navigator;
                navigator.look_along(navigator.target(), *along, navigator.distance());
            }
            Action::FirstView => self.camera.navigator = self.camera.home.clone(),
            Action::KeepCamera => self.keep_camera()?,
            Action::ShowKept(k) => {
                if let Some(camera) = self.camera.kept.list.get(*k) {
                    self.camera.navigator.stand_at(camera);
                    self.camera.kept.at = Some(*k);
                }
            }
            Action::RemoveKept(k) if *k < self.camera.kept.list.len() => {
                self.camera.kept.list.remove(*k);
                self.camera.kept.at = None;
                if *k < self.hud.cameras.thumbnails.len() {
                    self.hud.cameras.thumbnails.remove(*k);
                }
                let path = cameras_path(&self.session.path);
                self.hud.message = write_kept(&path, &self.camera.kept.list).err().map(|error| error.to_string());
            }
            _ => {}
        }
        Ok(())
    }

    /// After the scene was saved to another file: takes the cameras that were kept for that file, if there are some, so that
    /// keeping a camera adds to them. Returns a note for the user about it.
    pub(super) fn take_kept_cameras(&mut self, to: &Path) -> Option<String> {
        let list = cameras_kept_at(&self.session.path, to)?;
        self.camera.kept = CameraList { list, at: None };
        self.hud.cameras.thumbnails.clear();
        Some(texts::cameras_are_of(&cameras_path(to)))
    }

    /// Moves the camera, without turning it, until the selection fills most of the view.
    fn frame_chosen(&mut self) {
        let (scene, editor) = (self.session.viewer.scene(), self.session.viewer.editor());
        let Some(centre) = editor.chosen_centre(scene) else {
            self.hud.message = Some(texts::NOTHING_SELECTED.into());
            return;
        };
        let [_, _, up] = self.camera.navigator.level_axes();
        let radius = reach(scene, editor.chosen(), centre, up);
        self.camera.navigator.frame(centre, radius);
    }

    /// Starts recording the camera path, or ends it and writes the path beside the scene.
    pub(super) fn record_path(&mut self) {
        let Some(recording) = self.camera.recording.take() else {
            self.camera.recording = Some(Recording::default());
            self.hud.message = Some(texts::RECORDING.into());
            return;
        };
        let (path, cameras) = (self.session.free_name("path.json"), recording.cameras());
        self.hud.message = Some(match write_cameras(&path, &cameras) {
            Ok(()) => texts::path_written(cameras.len(), PATH_FPS, &path),
            Err(error) => {
                // It goes on, and can be written later.
                self.camera.recording = Some(recording);
                error.to_string()
            }
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

/// Radius of a ball around `centre` that holds the chosen instances but for their outliers, world units.
fn reach(scene: &InstancedScene, chosen: &BTreeSet<usize>, centre: DVec3, up: DVec3) -> f64 {
    let centres = instance_centres(scene, chosen.iter().copied());
    let reach = |(&k, middle): (&usize, &DVec3)| {
        let Footprint { extent: [width, depth], height, .. } = footprint(scene, k, up);
        middle.distance(centre) + width.max(depth).max(height)
    };
    chosen.iter().zip(&centres).map(reach).fold(0.0, f64::max)
}

/// Shows the next or previous of a list of cameras, cyclically; from none to the first or the last.
pub(super) fn step(cameras: &mut CameraList, by: isize, navigator: &mut Navigator, hud: &mut Hud) {
    let CameraList { list, at } = cameras;
    if list.is_empty() {
        hud.message = Some(texts::NO_CAMERAS_TO_STEP.into());
        return;
    }
    let next = stepped(*at, by, list.len());
    let camera = &list[next];
    navigator.stand_at(camera);
    hud.message = Some(texts::camera_of(next + 1, list.len(), &camera.name));
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

/// The first number that is no kept camera's name: pictures of cameras are named after them.
fn unused_name(kept: &[Camera]) -> String {
    let mut names = (0..).map(|k: u32| format!("{k:03}"));
    names.find(|name| kept.iter().all(|camera| camera.name != *name)).unwrap_or_default()
}

/// Writes the kept cameras. Without any there is no file: one without a camera cannot be read.
fn write_kept(path: &Path, kept: &[Camera]) -> Result<(), IoError> {
    if !kept.is_empty() {
        return write_cameras(path, kept);
    }
    remove_if_there(path)
}

/// The cameras that were kept for the scene at `to`, where a scene from another file is saved; `None` if there are none, or the
/// same as for the file that it is from.
fn cameras_kept_at(from: &Path, to: &Path) -> Option<Vec<Camera>> {
    let path = cameras_path(to);
    (path.exists() && !is_same_file(&path, &cameras_path(from))).then(|| kept_cameras(to))
}

/// Cameras that were kept earlier; none if there is no such file or it cannot be parsed.
pub(super) fn kept_cameras(scene: &Path) -> Vec<Camera> {
    read_cameras(&cameras_path(scene)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample_scene;

    fn camera(name: &str) -> Camera {
        Camera::look_at(name, DVec3::new(3.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z, 0.8, (160, 90))
    }

    #[test]
    fn no_two_kept_cameras_have_one_name() {
        let mut kept: Vec<Camera> = Vec::new();
        for _ in 0..3 {
            kept.push(camera(&unused_name(&kept)));
        }
        kept.remove(0);
        kept.push(camera(&unused_name(&kept)));
        kept.push(camera(&unused_name(&kept)));
        let names: Vec<&str> = kept.iter().map(|camera| camera.name.as_str()).collect();
        assert_eq!(names, ["001", "002", "000", "003"]);
    }

    /// The file without a camera would be taken for one that is not ours.
    #[test]
    fn the_last_camera_that_is_removed_takes_its_file_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.cameras.json");
        write_kept(&path, &[camera("000")]).unwrap();
        assert_eq!(read_cameras(&path).unwrap().len(), 1);
        write_kept(&path, &[]).unwrap();
        write_kept(&path, &[]).unwrap();
        assert!(!path.exists());
    }

    #[test]
    fn cameras_of_the_file_that_a_scene_is_saved_to_are_added_to() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_cameras(&at("a.cameras.json"), &[camera("000")]).unwrap();
        write_cameras(&at("b.cameras.json"), &[camera("000"), camera("001")]).unwrap();
        let count = |to: &str| cameras_kept_at(&at("a.ply"), &at(to)).map(|kept| kept.len());
        assert_eq!(count("b.instgs"), Some(2));
        assert_eq!((count("a.instgs"), count("c.instgs")), (None, None), "those of the window stay");
    }

    #[test]
    fn the_reach_of_a_selection_includes_the_height_of_tall_objects() {
        let mut scene = sample_scene();
        scene.templates.means.iter_mut().enumerate().for_each(|(i, mean)| mean[2] = 40.0 * i as f32);
        let Footprint { extent, height, .. } = footprint(&scene, 0, DVec3::Z);
        assert!(height > 2.0 * extent[0].max(extent[1]), "{height} {extent:?}");
        let centre = instance_centres(&scene, [0])[0];
        let radius = reach(&scene, &BTreeSet::from([0]), centre, DVec3::Z);
        for mean in &scene.templates.means[..3] {
            let place = DVec3::from_array(mean.map(f64::from));
            assert!(scene.instances[0].world_from_template.transform_point(place).distance(centre) <= radius);
        }
        assert_eq!(reach(&scene, &BTreeSet::new(), centre, DVec3::Z), 0.0);
    }

    #[test]
    fn back_and_forth_is_where_one_was() {
        assert_eq!((stepped(None, 1, 3), stepped(None, -1, 3)), (0, 2));
        assert_eq!((stepped(Some(0), 1, 3), stepped(Some(2), 1, 3), stepped(Some(0), -1, 3)), (1, 0, 2));
        assert_eq!(stepped(Some(stepped(Some(1), 1, 3)), -1, 3), 1);
    }
}
