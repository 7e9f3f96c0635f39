//! Scenes whose pages come in before a view is measured.

use std::cell::Cell;

use instgs_console::CliError;
use instgs_console::opened::{CoarserViews, DrawnScene};
use instgs_eval::SceneOfViews;
use instgs_vk::render::{DeviceScene, RenderOptions};
use instgs_vk::scene::Camera;

/// A scene that gets what each view wants, and counts the views that it has no room for.
pub(super) struct Followed<'a> {
    pub(super) scene: DrawnScene,
    /// Path of its file, for errors.
    pub(super) place: String,
    /// Number of views that are still to be counted: `bench` draws each one again and again.
    pub(super) left_to_count: usize,
    /// The views so far. The caller reads it when what measures, which owns this, is done.
    pub(super) counted: &'a Cell<CoarserViews>,
}

impl SceneOfViews<CliError> for Followed<'_> {
    fn ready_for(&mut self, camera: &Camera, options: &RenderOptions) -> Result<&DeviceScene, CliError> {
        let fail = |error| CliError::msg(format!("{}: view {}: {error}", self.place, camera.name));
        let pages = self.scene.follow(camera, options).map_err(fail)?;
        if self.left_to_count > 0 {
            self.left_to_count -= 1;
            let mut counted = self.counted.get();
            counted.add(&pages);
            self.counted.set(counted);
        }
        Ok(self.scene.device())
    }

    fn on_device(&self) -> &DeviceScene {
        self.scene.device()
    }
}
