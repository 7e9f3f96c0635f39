//! Questions before work is lost: what is lost, and what the user does once more to agree.

use std::path::Path;

use super::name_of;

/// What the user does once more; to open a file, see [`open_file`].
pub(crate) const PRESS_ESCAPE: &str = "press Escape";
pub(crate) const CLOSE_WINDOW: &str = "close";
/// What doing the same once more does to work that is unsaved, or still running.
pub(crate) const QUIT_UNSAVED: &str = "quit without saving";
pub(crate) const OPEN_UNSAVED: &str = "open it without saving";
pub(crate) const STOP_WORK: &str = "stop it";

/// A camera path is being recorded.
pub(crate) const PATH_UNSAVED: &str = "the camera path is not saved (P saves it)";

pub(crate) fn open_file(file: &Path) -> String {
    format!("open {}", name_of(file))
}

/// Changes of the scene; `boxes` is true while the tool for boxes is on, which has Ctrl+S for itself.
pub(crate) fn changes_unsaved(boxes: bool) -> String {
    format!("changes are not saved ({})", saves(!boxes))
}

/// Changes of boxes; `boxes` as in [`changes_unsaved`].
pub(crate) fn boxes_unsaved(boxes: bool) -> String {
    format!("boxes are not saved ({})", saves(boxes))
}

/// The keys that save; `at_once` if the tool does not have to be changed first.
fn saves(at_once: bool) -> &'static str {
    if at_once { "Ctrl+S saves them" } else { "B, then Ctrl+S saves them" }
}

pub(crate) fn is_running(work: &str) -> String {
    format!("{work} is still running")
}

/// The question: what is lost, what the user does, and what that does.
pub(crate) fn question(lost: &[String], how: &str, what: &str) -> String {
    format!("{}: {how} again to {what}", lost.join(", "))
}

/// Question before a file is replaced.
pub(crate) fn replace_again(file: &Path) -> String {
    format!("{} is there already: save again to replace it", file.display())
}
