//! The error type of reading and writing files: one line that says which file, where, what, and what to do.

use std::fmt;
use std::path::{Path, PathBuf};

/// What to do about a file that is not of the format of its ending.
pub(crate) const BY_ENDING: &str = "a file's ending says what it is: .ply, .spz, .sog, .splat, .glb or .instgs";

/// Where in a file something is wrong.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    #[default]
    File,
    /// A byte offset from the start of the file (of the decompressed data if the format is gzipped).
    Byte(u64),
    /// A line of a text file, counted from 1.
    Line(u64),
    /// A tensor of a `.instgs` file.
    Tensor(String),
    /// A field of a JSON or header structure, for instance `frames[3].transform_matrix`.
    Field(String),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Byte(offset) => write!(f, ": byte {offset}"),
            Self::Line(line) => write!(f, ": line {line}"),
            Self::Tensor(name) => write!(f, ": tensor {}", visible(name)),
            Self::Field(name) => write!(f, ": {}", visible(name)),
        }
    }
}

/// A file could not be read or written. Its text is one line for the user.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}{place}: {what}{}", path.display(), advice.as_ref().map(|a| format!("; {a}")).unwrap_or_default())]
pub struct IoError {
    /// Path of the file or folder.
    pub path: PathBuf,
    /// The place within the file.
    pub place: Place,
    /// What is wrong there.
    pub what: String,
    /// What the user can do, if that is known.
    pub advice: Option<String>,
}

impl IoError {
    /// An error about the file as a whole.
    pub fn new(path: &Path, what: impl Into<String>) -> Self {
        Self { path: path.into(), place: Place::File, what: one_line(&what.into()), advice: None }
    }

    /// The same error, located at a place in the file.
    pub fn at(mut self, place: Place) -> Self {
        self.place = place;
        self
    }

    /// The same error with advice for the user.
    pub fn advise(mut self, advice: impl Into<String>) -> Self {
        self.advice = Some(advice.into());
        self
    }

    /// An error about a file of the right kind that lost or never had a part.
    pub fn damaged(path: &Path, what: impl Into<String>) -> Self {
        Self::new(path, what).advise("copy the file again, or have its program write it anew")
    }

    /// An error about a file whose content does not fit the available memory.
    pub fn too_large(path: &Path, what: impl Into<String>) -> Self {
        Self::new(path, what).advise("close other programs, or use a machine with more memory")
    }

    /// An error of the operating system while doing `doing` ("cannot read", "cannot write").
    pub fn os(path: &Path, doing: &str, error: &std::io::Error) -> Self {
        Self::new(path, format!("{doing}: {error}"))
    }
}

/// Names come from files, and may hold line breaks.
fn visible(name: &str) -> String {
    let visible = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    name.chars().map(visible).collect()
}

/// Joins the lines of other crates' messages, since an error is one line.
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_one_line_with_path_place_reason_and_advice() {
        let e = IoError::new(Path::new("a/b.ply"), "ends\n early").at(Place::Byte(12)).advise("copy it again");
        assert_eq!(e.to_string(), "a/b.ply: byte 12: ends early; copy it again");
        assert_eq!(IoError::new(Path::new("x"), "y").to_string(), "x: y");
        // Found by `tools/fuzz checkpoint`.
        let e = IoError::new(Path::new("x"), "is missing").at(Place::Tensor("st\nms".into()));
        assert_eq!(e.to_string(), "x: tensor st\\nms: is missing");
    }
}
