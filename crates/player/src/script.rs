//! User input as lines of a text file, played back in a real window: for tests, for screenshots of tutorials, and for
//! bug reports. Each frame plays one line.
//!
//! ```text
//! size 640 480          resizes the window
//! pointer 120 80        moves the pointer; window pixels
//! press left            left, right or middle; likewise release
//! click 120 80          pointer, press and release
//! double 120 80         pointer, and two clicks before the next frame
//! drag left 10 10 90 60 pointer, press, pointer in eight steps, release
//! wheel 2               two steps towards the scene
//! key ctrl+shift+KeyZ   a key with its modifiers, by its place on a US keyboard; flight keys are only tapped
//! hold KeyW 12          a key is held for 12 frames
//! frames 5              5 frames without any input
//! tap Scatter copies    clicks the widget with this text in the panels
//! tap chair 7 +2        clicks the widget that is the second to the right of this text; -1 to the left
//! over Scene            moves the pointer onto the widget
//! type 2.5              replaces the text of the field that has the focus
//! enter                 confirms the field
//! pinch 0.25            two fingers on a touchpad spread by a quarter
//! pan 40 -8             two fingers on a touchpad move; window pixels
//! shot a.png            saves the frame without the overlay; paths are relative to the script
//! screen a.png          saves the next frame with the overlay
//! counts a.json         saves the number of submissions and host waits so far
//! found                 waits until a search for boxes has ended
//! boxes a.json          saves the boxes to a file
//! lose                  simulates a lost device: the following frames are drawn on a reopened one
//! drop a.ply            a file is dropped on the window, and read
//! begin a.ply           a file is dropped on the window, and the next steps are played while it is read
//! opened                waits until the file is open
//! close                 the window's close button, which asks if that loses work
//! quit                  closes the window
//! # and the rest of a line is a comment
//! ```

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use serde::Deserialize as _;
use serde::de::IntoDeserializer as _;
use serde::de::value::{Error, StrDeserializer};
use winit::keyboard::KeyCode;

use super::controls::Button;
use super::panel_texts::Target;

/// Frames of a drag from start to end.
const DRAG_STEPS: u32 = 8;

/// One input that is played back before a frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Resizes the window: width and height, pixels.
    Size([u32; 2]),
    /// Moves the pointer; window pixels.
    Pointer([f64; 2]),
    /// Presses (true) or releases a button.
    Button(Button, bool),
    /// Clicks twice with the left button.
    DoubleClick,
    /// Turns the wheel by a number of steps.
    Wheel(f64),
    /// Clicks a widget of the panels.
    Tap(Target),
    /// Moves the pointer onto a widget of the panels.
    Over(Target),
    /// Replaces the text of the field that has the focus.
    Type(String),
    /// Confirms the field that has the focus.
    Enter,
    /// Two fingers on a touchpad spread by a part of their distance (negative: close).
    Pinch(f64),
    /// Two fingers on a touchpad move; window pixels.
    Pan([f64; 2]),
    /// Presses and releases a key.
    Key {
        /// The key, by its place on a US keyboard.
        code: KeyCode,
        /// True if Ctrl is held.
        control: bool,
        /// True if Shift is held.
        shift: bool,
    },
    /// Presses (true) or releases a key.
    Hold(KeyCode, bool),
    /// Draws a frame without any input.
    Wait,
    /// Saves the frame to a PNG file.
    Shot(PathBuf),
    /// Saves the next frame with the overlay to a PNG file.
    Screen(PathBuf),
    /// Saves the number of submissions and host waits so far to a JSON file.
    Counts(PathBuf),
    /// Draws frames until the search has ended.
    Found,
    /// Saves the boxes to a file.
    Boxes(PathBuf),
    /// Simulates the loss of the device.
    Lose,
    /// Drops a file on the window.
    Drop(PathBuf),
    /// Drops a file on the window; the scene is not shown before [`Step::Opened`].
    Begin(PathBuf),
    /// Draws frames until the file that is being read is open.
    Opened,
    /// Presses the window's close button.
    Close,
    /// Closes the window without asking.
    Quit,
}

/// Why a script cannot be played.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct ScriptError {
    /// The number of the bad line, counted from 1.
    pub line: u64,
    /// What is wrong with the line.
    pub reason: ScriptReason,
}

/// What is wrong with a line of a script. Each variant holds the bad words.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ScriptReason {
    /// The line's first word is unknown, or the number of words after it is wrong.
    #[error("{0:?} is not a script step")]
    Step(String),
    /// A modifier before a key is unknown.
    #[error("{0:?} is neither ctrl nor shift")]
    Modifier(String),
    /// The name of a key is unknown.
    #[error("{0:?} is not a key; examples: KeyW, Digit1, ArrowLeft, F12")]
    Key(String),
    /// The name of a mouse button is unknown.
    #[error("{0:?} is not a button: left, right or middle")]
    Button(String),
    /// A position or a number of wheel steps is not a finite number.
    #[error("{0:?} is not a number")]
    Number(String),
    /// A number of frames is not a whole number or too large.
    #[error("{0:?} is not a number from 0 to 1000000")]
    Count(String),
    /// A side length of the window is not a whole number or out of range.
    #[error("{0:?} is not a size from 1 to 16384")]
    Size(String),
}

/// Parses a script; relative paths in it are relative to `folder`.
///
/// # Errors
/// The first line that is not a step.
pub fn parse(text: &str, folder: &Path) -> Result<VecDeque<Step>, ScriptError> {
    let mut steps = VecDeque::new();
    for (line, words) in (1..).zip(text.lines()) {
        let words: Vec<&str> = words.split('#').next().unwrap_or_default().split_whitespace().collect();
        let Some((&what, rest)) = words.split_first() else { continue };
        let of_line = of_line(what, rest, folder).map_err(|reason| ScriptError { line, reason })?;
        steps.extend(of_line);
    }
    Ok(steps)
}

fn of_line(what: &str, rest: &[&str], folder: &Path) -> Result<Vec<Step>, ScriptReason> {
    Ok(match (what, rest) {
        ("size", [width, height]) => vec![Step::Size([side(width)?, side(height)?])],
        ("pointer", [x, y]) => vec![Step::Pointer([number(x)?, number(y)?])],
        ("press", [button]) => vec![Step::Button(button_of(button)?, true)],
        ("release", [button]) => vec![Step::Button(button_of(button)?, false)],
        ("click", [x, y]) => {
            let at = Step::Pointer([number(x)?, number(y)?]);
            vec![at, Step::Button(Button::Left, true), Step::Button(Button::Left, false)]
        }
        ("double", [x, y]) => vec![Step::Pointer([number(x)?, number(y)?]), Step::DoubleClick],
        ("drag", [button, x0, y0, x1, y1]) => {
            drag(button_of(button)?, [number(x0)?, number(y0)?], [number(x1)?, number(y1)?])
        }
        ("wheel", [steps]) => vec![Step::Wheel(number(steps)?)],
        ("tap", [_, ..]) => vec![Step::Tap(target(rest)?)],
        ("over", [_, ..]) => vec![Step::Over(target(rest)?)],
        ("type", _) => vec![Step::Type(rest.join(" "))],
        ("enter", []) => vec![Step::Enter],
        ("pinch", [by]) => vec![Step::Pinch(number(by)?)],
        ("pan", [x, y]) => vec![Step::Pan([number(x)?, number(y)?])],
        ("key", [keys]) => vec![key(keys)?],
        ("hold", [code, pictures]) => {
            let code = key_code(code)?;
            let mut steps = vec![Step::Hold(code, true)];
            steps.extend(vec![Step::Wait; count(pictures)?]);
            steps.push(Step::Hold(code, false));
            steps
        }
        ("frames", [pictures]) => vec![Step::Wait; count(pictures)?],
        ("shot", [path]) => vec![Step::Shot(folder.join(path))],
        ("screen", [path]) => vec![Step::Screen(folder.join(path))],
        ("counts", [path]) => vec![Step::Counts(folder.join(path))],
        ("found", []) => vec![Step::Found],
        ("boxes", [path]) => vec![Step::Boxes(folder.join(path))],
        ("lose", []) => vec![Step::Lose],
        ("drop", [path]) => vec![Step::Drop(folder.join(path)), Step::Opened],
        ("begin", [path]) => vec![Step::Begin(folder.join(path))],
        ("opened", []) => vec![Step::Opened],
        ("close", []) => vec![Step::Close],
        ("quit", []) => vec![Step::Quit],
        _ => return Err(ScriptReason::Step([&[what], rest].concat().join(" "))),
    })
}

/// A text, and behind it maybe the number of widgets to the right (`+2`) or left (`-1`) of it.
fn target(words: &[&str]) -> Result<Target, ScriptReason> {
    let along = words.last().filter(|word| word.starts_with(['+', '-'])).and_then(|word| word.parse().ok());
    let text = words[..words.len() - usize::from(along.is_some())].join(" ");
    if text.is_empty() {
        return Err(ScriptReason::Step(words.join(" ")));
    }
    Ok(Target { text, along: along.unwrap_or(0) })
}

fn drag(button: Button, from: [f64; 2], to: [f64; 2]) -> Vec<Step> {
    let mut steps = vec![Step::Pointer(from), Step::Button(button, true)];
    steps.extend((1..=DRAG_STEPS).map(|k| {
        let part = f64::from(k) / f64::from(DRAG_STEPS);
        Step::Pointer([0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis])))
    }));
    steps.push(Step::Button(button, false));
    steps
}

fn key(keys: &str) -> Result<Step, ScriptReason> {
    let mut held: Vec<&str> = keys.split('+').collect();
    let code = key_code(held.pop().unwrap_or_default())?;
    if let Some(other) = held.iter().find(|&&h| h != "ctrl" && h != "shift") {
        return Err(ScriptReason::Modifier((*other).to_owned()));
    }
    Ok(Step::Key { code, control: held.contains(&"ctrl"), shift: held.contains(&"shift") })
}

fn key_code(name: &str) -> Result<KeyCode, ScriptReason> {
    let name_only: StrDeserializer<'_, Error> = name.into_deserializer();
    KeyCode::deserialize(name_only).map_err(|_| ScriptReason::Key(name.to_owned()))
}

fn button_of(name: &str) -> Result<Button, ScriptReason> {
    Ok(match name {
        "left" => Button::Left,
        "right" => Button::Right,
        "middle" => Button::Middle,
        _ => return Err(ScriptReason::Button(name.to_owned())),
    })
}

fn number(text: &str) -> Result<f64, ScriptReason> {
    text.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| ScriptReason::Number(text.to_owned()))
}

/// A number of frames, at most a million as for `--frames`.
fn count(text: &str) -> Result<usize, ScriptReason> {
    text.parse().ok().filter(|n| *n <= 1_000_000).ok_or_else(|| ScriptReason::Count(text.to_owned()))
}

/// A side length in pixels, at most 16384, which every device can draw.
fn side(text: &str) -> Result<u32, ScriptReason> {
    text.parse().ok().filter(|n| (1..=16384).contains(n)).ok_or_else(|| ScriptReason::Size(text.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_become_steps() {
        let text = "# a comment\n size 640 480\n\nclick 3 4.5 # there\nkey ctrl+shift+KeyZ\nhold KeyW 2\nshot a.png\ncounts a.json\nfound\n\
                    boxes b.json\ndrop c.ply\nbegin e.ply\ndouble 5 6\nclose\ntap Move by +2\nover Scene\ntype a b\nenter\npinch 0.5\n\
                    pan 3 -4\nscreen d.png\n";
        let target = |text: &str, along| Target { text: text.into(), along };
        let steps = parse(text, Path::new("there")).unwrap();
        let want = [
            Step::Size([640, 480]),
            Step::Pointer([3.0, 4.5]),
            Step::Button(Button::Left, true),
            Step::Button(Button::Left, false),
            Step::Key { code: KeyCode::KeyZ, control: true, shift: true },
            Step::Hold(KeyCode::KeyW, true),
            Step::Wait,
            Step::Wait,
            Step::Hold(KeyCode::KeyW, false),
            Step::Shot("there/a.png".into()),
            Step::Counts("there/a.json".into()),
            Step::Found,
            Step::Boxes("there/b.json".into()),
            Step::Drop("there/c.ply".into()),
            Step::Opened,
            Step::Begin("there/e.ply".into()),
            Step::Pointer([5.0, 6.0]),
            Step::DoubleClick,
            Step::Close,
            Step::Tap(target("Move by", 2)),
            Step::Over(target("Scene", 0)),
            Step::Type("a b".into()),
            Step::Enter,
            Step::Pinch(0.5),
            Step::Pan([3.0, -4.0]),
            Step::Screen("there/d.png".into()),
        ];
        assert_eq!(Vec::from(steps), want);
        let drag = Vec::from(parse("drag middle 0 0 16 8", Path::new("")).unwrap());
        assert_eq!(drag.len(), 3 + DRAG_STEPS as usize);
        assert_eq!((&drag[2], &drag[9]), (&Step::Pointer([2.0, 1.0]), &Step::Pointer([16.0, 8.0])));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, words) in [
            ("frames 2\njump 3", ["line 2", "jump 3"]),
            ("key ctrl+Foo", ["line 1", "Foo"]),
            ("key alt+KeyA", ["line 1", "alt"]),
            ("pointer 1", ["line 1", "pointer 1"]),
            ("pointer nan 1", ["line 1", "nan"]),
            ("press top", ["line 1", "top"]),
            ("frames -1", ["line 1", "-1"]),
            ("size 0 4", ["line 1", "\"0\""]),
            ("tap +1", ["line 1", "+1"]),
        ] {
            let error = parse(text, Path::new("")).unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
        }
        let error = parse("frames 2\nhold Foo 3", Path::new("")).unwrap_err();
        assert_eq!(error, ScriptError { line: 2, reason: ScriptReason::Key("Foo".into()) });
    }
}
