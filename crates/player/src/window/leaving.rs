//! Before work is lost: the user is asked once, and what is not saved is written when the player has to end.

use std::path::PathBuf;

use super::{After, Live};
use instgs_io::write_boxes;

impl Live {
    /// Ends; but if something is not saved, says so first.
    pub(super) fn leave(&mut self, once_more: &str) -> After {
        if self.asks_first(once_more) { After::Redraw } else { After::Quit }
    }

    /// The window is to be closed.
    pub(super) fn close(&mut self) -> After {
        self.leave("closing once more leaves")
    }

    /// True if something is not saved and the user has not been told so just now; then the window says it, and that doing
    /// the same `once_more` goes on without it. A key or a button in between starts this again.
    pub(super) fn asks_first(&mut self, once_more: &str) -> bool {
        if !self.is_unsaved() || self.warned.as_deref() == Some(once_more) {
            return false;
        }
        self.warned = Some(once_more.to_string());
        let which = if self.boxing.is_unsaved() { "boxes are not saved: B, then " } else { "changes are not saved: " };
        self.hud.message = Some(format!("the {which}Ctrl+S saves, {once_more}"));
        true
    }

    /// Writes what is not saved beside the scene, under names that are free: the player cannot go on. Which files, and what
    /// could not be written.
    pub(super) fn rescue(&mut self) -> (Vec<PathBuf>, Vec<String>) {
        let (mut files, mut errors) = (Vec::new(), Vec::new());
        let mut note = |path: PathBuf, failed: Option<String>| match failed {
            None => files.push(path),
            Some(reason) => errors.push(reason),
        };
        if self.stage.editor().is_unsaved() {
            let path = self.free_name("recovered.instgs");
            let failed = self.stage.write_copy(&path).err().map(|e| e.to_string());
            note(path, failed);
        }
        if self.boxing.is_unsaved() {
            let path = self.free_name("recovered.boxes.json");
            let failed = write_boxes(&path, &self.boxing.boxes_of_file()).err().map(|e| e.to_string());
            note(path, failed);
        }
        (files, errors)
    }
}
