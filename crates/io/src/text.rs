//! Text files as other programs write them: with a byte order mark, with line breaks of any kind, and not always as UTF-8.

use std::path::Path;

use crate::error::{IoError, Place};

/// The byte order mark of UTF-8, which Windows programs put first.
const MARK: &[u8] = b"\xEF\xBB\xBF";
/// The marks of UTF-16, both byte orders.
const MARKS_16: [&[u8]; 2] = [b"\xFF\xFE", b"\xFE\xFF"];

/// The text of a file, without a byte order mark.
///
/// # Errors
/// It is not UTF-8; the error names the byte.
pub(crate) fn text_of<'a>(bytes: &'a [u8], path: &Path) -> Result<&'a str, IoError> {
    if MARKS_16.iter().any(|mark| bytes.starts_with(mark)) {
        return Err(IoError::new(path, "is UTF-16 text").advise("save it as UTF-8"));
    }
    let start = if bytes.starts_with(MARK) { MARK.len() } else { 0 };
    std::str::from_utf8(&bytes[start..]).map_err(|e| {
        let at = start + e.valid_up_to();
        let byte = bytes.get(at).copied().unwrap_or_default();
        let what = format!("is not UTF-8 text: the byte 0x{byte:02X} begins no character");
        IoError::new(path, what).at(Place::Byte(at as u64)).advise("save it as UTF-8")
    })
}

/// An error of a JSON file: its line, what is wrong, and the character that is there.
pub(crate) fn json_error(text: &str, path: &Path, error: &serde_json::Error) -> IoError {
    // serde_json counts columns in bytes, from 1; 0 is before the first one, at a line break.
    let line = text.lines().nth(error.line().saturating_sub(1)).unwrap_or_default();
    let found = line.get(error.column().saturating_sub(1)..).and_then(|rest| rest.chars().next());
    let found = match found {
        Some(c) if error.is_syntax() => format!(", where the file has \"{}\"", c.escape_debug()),
        _ => String::new(),
    };
    IoError::new(path, format!("is not valid JSON: {error}{found}")).at(Place::Line(error.line() as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_skipped_and_other_encodings_named() {
        let path = Path::new("a.txt");
        assert_eq!(text_of(b"\xEF\xBB\xBF{}", path).ok(), Some("{}"));
        assert_eq!(text_of(b"\xEF\xBB\xBF", path).ok(), Some(""));
        let error = |bytes: &[u8]| text_of(bytes, path).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error(b"\xFF\xFE{\0}\0").contains("UTF-16"));
        assert!(error(b"\xEF\xBB\xBFa\xE9b").contains("byte 4") && error(b"a\xE9b").contains("0xE9"));
    }

    #[test]
    fn json_errors_show_what_is_there() {
        let error = |text: &str| {
            let error = serde_json::from_str::<serde_json::Value>(text).err();
            error.map(|e| json_error(text, Path::new("a.json"), &e).to_string()).unwrap_or_default()
        };
        assert!(error("{\"a\": 1,\n}").contains("line 2") && error("{\"a\": 1,\n}").contains("has \"}\""));
        assert!(error("[1, 2,]").contains("has \"]\""), "{}", error("[1, 2,]"));
        assert!(error("{").contains("EOF"), "{}", error("{"));
    }
}
