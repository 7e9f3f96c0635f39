//! Damaged files for every reader. A [`Target`] is a reader with a few small valid files, its seeds; [`inputs`] makes damaged ones of
//! them, the same for the same number. [`worker`] gives them to the reader, in a process of its own, since a reader that takes all
//! memory or all of the stack ends its process; [`supervisor`] starts such processes, finds the input that ended one, and saves it.
//!
//! A reader passes if each input gives a value or an error of one line, within limits of time and memory, and if what was read can
//! be written and read again (`properties.rs`).

pub mod inputs;
mod mutation;
mod properties;
mod random_scene;
mod repair;
pub mod seeds;
pub mod supervisor;
pub mod targets;
pub mod worker;

use std::fmt::Display;
use std::path::Path;

/// What a seed cannot be made for: a fault of this crate or of a writer.
pub type SeedError = Box<dyn std::error::Error + Send + Sync>;

/// A small valid file.
#[derive(Clone, Debug)]
pub struct Seed {
    /// What sets it apart from the other seeds of its target.
    pub name: &'static str,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl Seed {
    /// A seed with a name.
    pub fn new(name: &'static str, bytes: impl Into<Vec<u8>>) -> Self {
        Self { name, bytes: bytes.into() }
    }
}

/// A reader, with what its inputs are made from.
#[derive(Clone, Copy)]
pub struct Target {
    /// Its name on the command line.
    pub name: &'static str,
    /// Makes its seeds, at least one.
    pub seeds: fn() -> Result<Vec<Seed>, SeedError>,
    /// Makes checksums and lengths fit again, of an input that was changed: else few changes get beyond them.
    pub repair: Option<fn(&mut Vec<u8>)>,
    /// Reads an input; true if it was accepted. May write into the folder. Panics if a promise is broken.
    pub read: fn(&[u8], &Path) -> bool,
}

/// The value of a reader's result.
///
/// # Panics
/// The error's text is empty, longer than 2000 bytes, or not one line.
pub(crate) fn taken<T, E: Display>(result: Result<T, E>) -> Option<T> {
    match result {
        Ok(value) => Some(value),
        Err(error) => {
            let text = error.to_string();
            let is_line = !text.is_empty() && !text.contains('\n') && text.len() < 2000;
            assert!(is_line, "an error of {} bytes: {:?}", text.len(), text.chars().take(300).collect::<String>());
            None
        }
    }
}

/// The value of a result that must be there.
///
/// # Panics
/// It is not; `what` says what was promised.
pub(crate) fn must<T, E: Display>(result: Result<T, E>, what: &str) -> T {
    result.unwrap_or_else(|error| panic!("{what}: {error}"))
}

/// The path that readers of bytes put into messages.
pub(crate) fn path() -> &'static Path {
    Path::new("damaged/transforms.json")
}
