//! Errors in a configuration, each one line for the user.

use instgs_io::IoError;

/// Why a configuration was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error(transparent)]
    File(#[from] IoError),
    /// The text is not TOML, or not `key=value`.
    #[error("{origin}: {what}")]
    Syntax {
        /// Which file (and line) or argument.
        origin: String,
        /// What is wrong and what to do.
        what: String,
    },
    /// The key does not exist.
    #[error("{origin}: unknown key {key}; did you mean {nearest}?")]
    UnknownKey {
        /// Which file or argument.
        origin: String,
        /// The key as written, dotted.
        key: String,
        /// The known key nearest to it.
        nearest: String,
    },
    /// The value has the wrong type or is out of range.
    #[error("{origin}: {key} = {value}: must be {allowed}")]
    Value {
        /// Which file or argument.
        origin: String,
        /// The dotted name of the key.
        key: String,
        /// The refused value as TOML.
        value: String,
        /// The values that the key accepts.
        allowed: String,
    },
    /// Two values that do not go together.
    #[error("{first} must be {relation} {second}")]
    Conflict {
        /// Key, value and where it was set.
        first: String,
        /// The relation that must hold between them, for instance "at most".
        relation: &'static str,
        /// Key, value and where it was set.
        second: String,
    },
}

impl ConfigError {
    /// The error of a configuration made in code whose values no file can hold.
    pub(super) fn unwritable(what: &str) -> Self {
        Self::Syntax { origin: "configuration".into(), what: one_line(what) }
    }
}

/// Texts of other crates may hold line breaks; an error is one line.
pub(super) fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
