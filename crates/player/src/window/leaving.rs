//! Protection of unsaved work: the user is asked once, and unsaved work is written if the player has to end.

use std::path::PathBuf;

use super::{After, Live};
use crate::texts;
use instgs_io::write_boxes;

impl Live {
    /// Quits; if something is unsaved, warns first.
    pub(super) fn leave(&mut self, once_more: &str) -> After {
        if self.asks_first(once_more) { After::Redraw } else { After::Quit }
    }

    /// Handles a request to close the window.
    pub(super) fn close(&mut self) -> After {
        self.leave(texts::CLOSE_AGAIN)
    }

    /// True if something is unsaved and the user has not just been warned; then displays that doing the same
    /// `once_more` continues without saving. A key or a button in between resets the warning.
    pub(super) fn asks_first(&mut self, once_more: &str) -> bool {
        self.wait_for_saving();
        if !self.is_unsaved() || self.input.warned.as_deref() == Some(once_more) {
            return false;
        }
        self.input.warned = Some(once_more.to_string());
        let which = if self.input.boxing.is_unsaved() { texts::BOXES_UNSAVED } else { texts::CHANGES_UNSAVED };
        self.hud.message = Some(format!("{which}{once_more}"));
        true
    }

    /// Writes unsaved work beside the scene under unused names, since the player cannot continue. Returns the files,
    /// and the errors of those that could not be written.
    pub(super) fn rescue(&mut self) -> (Vec<PathBuf>, Vec<String>) {
        let (mut files, mut errors) = (Vec::new(), Vec::new());
        let mut note = |path: PathBuf, failed: Option<String>| match failed {
            None => files.push(path),
            Some(reason) => errors.push(reason),
        };
        if self.session.viewer.editor().is_unsaved() {
            let path = self.session.free_name("recovered.instgs");
            let failed = self.session.viewer.write_copy(&path).err().map(|e| e.to_string());
            note(path, failed);
        }
        if self.input.boxing.is_unsaved() {
            let path = self.session.free_name("recovered.boxes.json");
            let failed = write_boxes(&path, &self.input.boxing.boxes_of_file()).err().map(|e| e.to_string());
            note(path, failed);
        }
        (files, errors)
    }
}
