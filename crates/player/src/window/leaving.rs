//! Protection of unsaved and running work and of files that would be replaced: the user is asked once, and unsaved work is
//! written if the player has to end.

use std::path::{Path, PathBuf};

use winit::keyboard::KeyCode;

use super::parts::free_names;
use super::{After, Live};
use crate::recording::Recording;
use crate::texts;
use instgs_io::{write_boxes, write_cameras};

/// What the user does that loses work.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Leaving {
    /// Quits with Escape.
    Escape,
    /// Closes the window.
    Close,
    /// Opens a file. Two files of one name are not the same.
    Open(PathBuf),
}

/// One piece of work that closing the window or opening another file loses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Loss {
    /// Work beside the picture, by its name.
    Running(String),
    /// The camera path that is being recorded.
    Path,
    Boxes,
    /// Changes of the scene.
    Changes,
}

/// A question that was just displayed. Doing the same once more answers it; anything else withdraws it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    /// Whether work may be lost.
    Lose(Leaving, Vec<Loss>),
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
            Self::Lose(..) => code == KeyCode::Escape,
            Self::Replace(_) => code == KeyCode::KeyS && control && !shift,
        }
    }
}

impl Leaving {
    /// The question whether work may be lost; `boxes` is true while the tool for boxes is on.
    fn question(&self, losses: &[Loss], boxes: bool) -> String {
        let (how, unsaved) = match self {
            Self::Escape => (texts::PRESS_ESCAPE.to_owned(), texts::QUIT_UNSAVED),
            Self::Close => (texts::CLOSE_WINDOW.to_owned(), texts::QUIT_UNSAVED),
            Self::Open(path) => (texts::open_file(path), texts::OPEN_UNSAVED),
        };
        let only_stops = losses.iter().all(|loss| matches!(loss, Loss::Running(_)));
        let words: Vec<String> = losses.iter().map(|loss| loss.words(boxes)).collect();
        texts::question(&words, &how, if only_stops { texts::STOP_WORK } else { unsaved })
    }
}

impl Loss {
    fn words(&self, boxes: bool) -> String {
        match self {
            Self::Running(work) => texts::is_running(work),
            Self::Path => texts::PATH_UNSAVED.into(),
            Self::Boxes => texts::boxes_unsaved(boxes),
            Self::Changes => texts::changes_unsaved(boxes),
        }
    }
}

impl Live {
    /// Quits; if that loses work, asks first.
    pub(super) fn leave(&mut self, how: Leaving) -> After {
        if self.asks_first(how) {
            return After::Redraw;
        }
        self.stop_work();
        After::Quit
    }

    /// Handles a request to close the window.
    pub(super) fn close(&mut self) -> After {
        self.leave(Leaving::Close)
    }

    /// True if what the user does would lose work, and the user has not just been asked; then displays that doing the same once
    /// more loses it. A key, a click in the picture or another action of the panels in between withdraws the question.
    pub(super) fn asks_first(&mut self, how: Leaving) -> bool {
        if self.wait_for_saving().is_err() {
            // The notice says why the file could not be saved, and is to be read.
            return true;
        }
        let losses: Vec<Loss> = self.work_to_stop().map(Loss::Running).into_iter().chain(self.unsaved()).collect();
        if losses.is_empty() {
            return false;
        }
        let question = how.question(&losses, self.input.boxing.on);
        let asks = ask(&mut self.input.asked, Asked::Lose(how, losses));
        if asks {
            self.hud.message = Some(question);
        }
        asks
    }

    /// True if closing the window would lose changes of the scene or of boxes, or a camera path.
    pub(super) fn is_unsaved(&self) -> bool {
        !self.unsaved().is_empty()
    }

    fn unsaved(&self) -> Vec<Loss> {
        let (path, boxes) = (self.camera.recording.is_some(), self.input.boxing.is_unsaved());
        let changes = self.session.viewer.editor().is_unsaved();
        let all = [(path, Loss::Path), (boxes, Loss::Boxes), (changes, Loss::Changes)];
        all.into_iter().filter_map(|(is_unsaved, loss)| is_unsaved.then_some(loss)).collect()
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

    /// Writes unsaved work under unused names, since the player cannot continue: beside the scene, or else in the folder for
    /// temporary files. Returns the files, and the errors of what could be written to neither.
    pub(super) fn rescue(&self) -> (Vec<PathBuf>, Vec<String>) {
        let folders = [self.session.path.clone(), in_folder(&std::env::temp_dir(), &self.session.path)];
        let (mut files, mut errors) = (Vec::new(), Vec::new());
        let mut rescued = |ending: &str, write: &dyn Fn(&Path) -> Result<(), String>| {
            let written = write_to_one_of(&folders, ending, write);
            match written {
                Ok(path) => files.push(path),
                Err(reason) => errors.push(reason),
            }
        };
        if self.session.viewer.editor().is_unsaved() {
            rescued("recovered.instgs", &|path| self.session.viewer.write_copy(path).map_err(|e| e.to_string()));
        }
        if self.input.boxing.is_unsaved() {
            let boxes = self.input.boxing.boxes_of_file();
            rescued("recovered.boxes.json", &|path| write_boxes(path, &boxes).map_err(|e| e.to_string()));
        }
        let recorded = self.camera.recording.as_ref().map(Recording::cameras).filter(|cameras| !cameras.is_empty());
        if let Some(cameras) = recorded {
            rescued("recovered.path.json", &|path| write_cameras(path, &cameras).map_err(|e| e.to_string()));
        }
        (files, errors)
    }
}

/// A file's name in a folder.
fn in_folder(folder: &Path, file: &Path) -> PathBuf {
    folder.join(file.file_name().unwrap_or("instgs".as_ref()))
}

/// Writes a file under an unused name with an extension beside the first of some files where that succeeds.
///
/// # Errors
/// The reasons of all files, in their order: none could be written.
fn write_to_one_of(
    beside: &[PathBuf],
    ending: &str,
    write: &dyn Fn(&Path) -> Result<(), String>,
) -> Result<PathBuf, String> {
    let mut reasons = Vec::new();
    for file in beside {
        let [path] = free_names(file, [ending]);
        match write(&path) {
            Ok(()) => return Ok(path),
            Err(reason) => reasons.push(reason),
        }
    }
    Err(reasons.join(", "))
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
    fn a_question_about_other_work_or_another_file_is_another() {
        let asked = |how: Leaving, losses: &[Loss]| Asked::Lose(how, losses.to_vec());
        let drop = |path: &str| asked(Leaving::Open(path.into()), &[Loss::Changes]);
        let close = |losses: &[Loss]| asked(Leaving::Close, losses);
        let mut last = None;
        assert!(ask(&mut last, drop("a/room.ply")) && ask(&mut last, drop("b/room.ply")), "of the same name");
        assert!(!ask(&mut last, drop("b/room.ply")));
        assert!(ask(&mut last, close(&[Loss::Changes])) && ask(&mut last, close(&[Loss::Path, Loss::Changes])));
        assert!(!ask(&mut last, close(&[Loss::Path, Loss::Changes])));
    }

    #[test]
    fn questions_say_what_is_lost_and_how_it_is_saved() {
        let running = || Loss::Running("Exporting a.ply".into());
        for (how, losses, boxes, want) in [
            (Leaving::Close, vec![running()], false, "Exporting a.ply is still running: close again to stop it"),
            (
                Leaving::Escape,
                vec![running(), Loss::Changes],
                false,
                "Exporting a.ply is still running, changes are not saved (Ctrl+S saves them): press Escape again to quit \
                 without saving",
            ),
            (
                Leaving::Open("x/b.ply".into()),
                vec![Loss::Boxes, Loss::Changes],
                true,
                "boxes are not saved (Ctrl+S saves them), changes are not saved (B, then Ctrl+S saves them): open b.ply \
                 again to open it without saving",
            ),
            (
                Leaving::Close,
                vec![Loss::Boxes],
                false,
                "boxes are not saved (B, then Ctrl+S saves them): close again to quit without saving",
            ),
        ] {
            assert_eq!(how.question(&losses, boxes), want);
        }
    }

    #[test]
    fn what_cannot_be_written_beside_the_scene_is_written_elsewhere() {
        let folder = tempfile::tempdir().unwrap();
        let gone = folder.path().join("gone").join("room.ply");
        let folders = [gone.clone(), in_folder(folder.path(), &gone)];
        let write = |path: &Path| std::fs::write(path, "x").map_err(|error| error.to_string());
        for number in ["000", "001"] {
            let path = write_to_one_of(&folders, "recovered.instgs", &write).unwrap();
            assert_eq!(path, folder.path().join(format!("room.{number}.recovered.instgs")));
        }
        let reasons = write_to_one_of(&[gone.clone(), gone], "recovered.instgs", &write).unwrap_err();
        assert_eq!(reasons.matches(", ").count(), 1, "{reasons}");
    }

    #[test]
    fn only_the_key_of_the_answer_leaves_a_question() {
        let (leaves, replaces) = (Asked::Lose(Leaving::Escape, Vec::new()), Asked::Replace("a.ply".into()));
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
