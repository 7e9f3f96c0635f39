//! Protection of unsaved work and of files that would be replaced: the user is asked once, and unsaved work is written if the
//! player has to end.

use std::path::{Path, PathBuf};

use winit::keyboard::KeyCode;

use super::{After, Live};
use crate::texts;
use instgs_io::write_boxes;

/// A question that was just displayed. Doing the same once more answers it; anything else withdraws it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    /// Whether unsaved work may be lost: what the question says that loses it.
    Unsaved(String),
    /// Whether a file may be replaced.
    Replace(PathBuf),
}

/// Keys that mean nothing by themselves.
const MODIFIERS: [KeyCode; 8] = [
    KeyCode::ControlLeft,
    KeyCode::ControlRight,
    KeyCode::ShiftLeft,
    KeyCode::ShiftRight,
    KeyCode::AltLeft,
    KeyCode::AltRight,
    KeyCode::SuperLeft,
    KeyCode::SuperRight,
];

impl Asked {
    /// True if a key, with Ctrl or Shift held, may be the answer, or is one that is held for it, so that the question stays.
    pub(super) fn stays_at(&self, code: KeyCode, control: bool, shift: bool) -> bool {
        match self {
            _ if MODIFIERS.contains(&code) => true,
            Self::Unsaved(_) => code == KeyCode::Escape,
            Self::Replace(_) => code == KeyCode::KeyS && control && !shift,
        }
    }
}

impl Live {
    /// Quits; if something is unsaved, warns first.
    pub(super) fn leave(&mut self, once_more: &str) -> After {
        if self.asks_first(once_more) { After::Redraw } else { After::Quit }
    }

    /// Handles a request to close the window.
    pub(super) fn close(&mut self) -> After {
        self.leave(texts::CLOSE_AGAIN)
    }

    /// True if something is unsaved and the user has not just been asked; then displays that doing the same `once_more`
    /// continues without saving. A key, a click in the picture or another action of the panels in between withdraws the question.
    pub(super) fn asks_first(&mut self, once_more: &str) -> bool {
        self.wait_for_saving();
        if !self.is_unsaved() || !ask(&mut self.input.asked, Asked::Unsaved(once_more.to_owned())) {
            return false;
        }
        let which = if self.input.boxing.is_unsaved() { texts::BOXES_UNSAVED } else { texts::CHANGES_UNSAVED };
        self.hud.message = Some(format!("{which}{once_more}"));
        true
    }

    /// True if a file is at `to`, may not be replaced yet, and the user has not just been asked about it; then displays that
    /// saving once more replaces it.
    pub(super) fn asks_to_replace(&mut self, to: &Path, may_replace: bool) -> bool {
        let asks = !may_replace && to.exists() && ask(&mut self.input.asked, Asked::Replace(to.to_path_buf()));
        if asks {
            self.hud.message = Some(texts::replace_again(to));
        } else {
            self.input.asked = None;
        }
        asks
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

/// Asks a question, unless it is the one that was asked last, which this answers. True if it is asked.
fn ask(last: &mut Option<Asked>, question: Asked) -> bool {
    let is_answered = last.take_if(|asked| *asked == question).is_some();
    if !is_answered {
        *last = Some(question);
    }
    !is_answered
}

/// True if two paths lead to the same file.
pub(super) fn is_same_file(a: &Path, b: &Path) -> bool {
    a == b || matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_question_is_asked_once_and_answered_by_the_same() {
        let [a, b] = ["a.ply", "b.ply"].map(|name| Asked::Replace(name.into()));
        let mut last = None;
        assert!(ask(&mut last, a.clone()) && ask(&mut last, b.clone()), "another file is another question");
        assert!(ask(&mut last, a.clone()) && !ask(&mut last, a.clone()), "the same is the answer");
        assert!(ask(&mut last, a), "the next time it is asked again");
    }

    #[test]
    fn only_the_key_of_the_answer_leaves_a_question() {
        let (leaves, replaces) = (Asked::Unsaved("x".into()), Asked::Replace("a.ply".into()));
        for (code, control, shift, stay) in [
            (KeyCode::Escape, false, false, [true, false]),
            (KeyCode::KeyS, true, false, [false, true]),
            (KeyCode::KeyS, true, true, [false, false]),
            (KeyCode::KeyS, false, false, [false, false]),
            (KeyCode::KeyA, true, false, [false, false]),
            (KeyCode::ControlLeft, true, false, [true, true]),
            (KeyCode::AltRight, false, false, [true, true]),
        ] {
            let got = [&leaves, &replaces].map(|asked| asked.stays_at(code, control, shift));
            assert_eq!(got, stay, "{code:?} {control} {shift}");
        }
    }

    #[test]
    fn a_file_is_known_by_other_paths_to_it() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b, inner] = ["a.ply", "b.ply", "inner"].map(|name| folder.path().join(name));
        std::fs::create_dir(&inner).unwrap();
        let other = inner.join("..").join("a.ply");
        assert!(is_same_file(&a, &a), "also if there is none yet");
        [&a, &b].into_iter().for_each(|path| std::fs::write(path, "x").unwrap());
        assert!(is_same_file(&a, &other) && !is_same_file(&a, &b));
    }
}
