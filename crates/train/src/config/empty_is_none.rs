//! Serde functions for optional values in configuration files: an empty string stands for `None`.

use std::ffi::OsStr;

use serde::{Deserialize, Deserializer, Serializer, ser};

/// Writes the value as a string, and `None` as an empty one.
///
/// # Errors
/// The value is a path that is not UTF-8 text.
pub fn serialize<T: AsRef<OsStr>, S: Serializer>(value: &Option<T>, serializer: S) -> Result<S::Ok, S::Error> {
    let text = value.as_ref().map_or(OsStr::new(""), AsRef::as_ref);
    match text.to_str() {
        Some(text) => serializer.serialize_str(text),
        None => Err(ser::Error::custom(format!("{} is not UTF-8 text", text.display()))),
    }
}

/// Reads a string; an empty one is `None`.
///
/// # Errors
/// The value is not a string.
pub fn deserialize<'de, T: From<String>, D: Deserializer<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    let text = String::deserialize(deserializer)?;
    Ok((!text.is_empty()).then(|| text.into()))
}
