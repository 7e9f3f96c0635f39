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
    /// Views that are still to be counted: measuring frames draws each one again and again.
    pub(super) to_count: usize,
    pub(super) views: &'a Cell<CoarserViews>,
}

impl SceneOfViews<CliError> for Followed<'_> {
    fn ready_for(&mut self, camera: &Camera, options: &RenderOptions) -> Result<&DeviceScene, CliError> {
        let fail = |error| CliError::msg(format!("{}: view {}: {error}", self.place, camera.name));
        let pages = self.scene.follow(camera, options).map_err(fail)?;
        if self.to_count > 0 {
            self.to_count -= 1;
            let mut views = self.views.get();
            views.add(&pages);
            self.views.set(views);
        }
        Ok(self.scene.device())
    }
}

/// For counts that are left out of JSON where nothing is coarser.
pub(super) fn is_none(count: &usize) -> bool {
    *count == 0
}
