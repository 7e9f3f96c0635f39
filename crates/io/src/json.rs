//! Serialisable records as JSON files.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{IoError, atomic_write, read_bytes};
use crate::error::Place;
use crate::text::{json_error, text_of};

/// Reads a record from a JSON file.
///
/// # Errors
/// The file is missing, is not JSON, or does not match the type; the error names the line.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, IoError> {
    parse_record(&read_bytes(path)?, path)
}

/// Parses the bytes of a JSON file as a record; `path` is only used in messages.
///
/// # Errors
/// The same errors as [`read_json`], but for a missing file.
pub(crate) fn parse_record<T: DeserializeOwned>(bytes: &[u8], path: &Path) -> Result<T, IoError> {
    let text = text_of(bytes, path)?;
    serde_json::from_str(text).map_err(|e| match e.is_data() {
        true => IoError::new(path, format!("cannot be used: {e}")).at(Place::Line(e.line() as u64)),
        false => json_error(text, path, &e),
    })
}

/// Writes a record as indented JSON.
///
/// # Errors
/// The file cannot be written, or the record has a value that JSON cannot represent.
pub fn write_json(path: &Path, record: &(impl Serialize + ?Sized)) -> Result<(), IoError> {
    let bytes = serde_json::to_vec_pretty(record).map_err(|e| IoError::new(path, format!("cannot write: {e}")))?;
    atomic_write(path, |out| out.write_all(&bytes).and_then(|()| out.write_all(b"\n")))
}

/// Serialises pairs as a JSON object whose members are in the order of the list.
///
/// # Errors
/// Those of the serialiser.
pub fn as_map<K: Serialize, S: Serializer>(pairs: &[(K, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().map(|(name, value)| (name, value)))
}

/// Deserialises a number, for serde's `deserialize_with`: `null` is NaN. JSON has no NaN and no infinities, so they are
/// written as `null`.
///
/// # Errors
/// Those of the deserialiser.
pub fn null_is_nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_back_and_errors_name_the_line() -> Result<(), IoError> {
        let folder = tempfile::tempdir().map_err(|e| IoError::new(Path::new("."), e.to_string()))?;
        let path = folder.path().join("a.json");
        write_json(&path, &[(1u32, "a")])?;
        assert_eq!(read_json::<Vec<(u32, String)>>(&path)?, [(1, "a".into())]);
        std::fs::write(&path, "[\n1,\n}").map_err(|e| IoError::new(&path, e.to_string()))?;
        let text = read_json::<Vec<u32>>(&path).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("a.json") && text.contains("line 3"), "{text}");
        Ok(())
    }
}
