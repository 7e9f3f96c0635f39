//! A path in a text field. A path need not be a text: the field keeps the path that it was given until the text is changed.

use std::path::{Path, PathBuf};

/// A text field for a path, which keeps a path that is no UTF-8 until the user changes the text.
#[derive(Default)]
pub(super) struct PathField {
    /// What the field shows, to be changed by the user.
    pub(super) text: String,
    given: PathBuf,
}

impl PathField {
    /// Fills the field with a path.
    pub(super) fn give(&mut self, path: &Path) {
        (self.text, self.given) = (path.display().to_string(), path.to_path_buf());
    }

    /// True if nothing is in the field.
    pub(super) fn is_empty(&self) -> bool {
        self.text.is_empty()
    }

    /// Forgets text and path, so that the field begins with the next default.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }

    /// The path that the field was given, or what was typed instead; `None` if there is none.
    pub(super) fn path(&self) -> Option<PathBuf> {
        let is_given = self.text == self.given.display().to_string();
        let path = if is_given { self.given.clone() } else { PathBuf::from(self.text.trim()) };
        Some(path).filter(|path| !path.as_os_str().is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_typed_counts_without_the_blanks_around_it() {
        let mut field = PathField::default();
        assert!(field.is_empty() && field.path().is_none());
        field.text = " a b.ply ".into();
        assert_eq!(field.path(), Some("a b.ply".into()));
        field.text = "  ".into();
        assert_eq!(field.path(), None);
        field.give(Path::new("c.ply "));
        assert_eq!(field.path(), Some("c.ply ".into()), "a path that was given is no typed text");
        field.clear();
        assert!(field.is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn a_path_that_is_no_text_stays_as_it_is() {
        use std::os::unix::ffi::OsStrExt;
        let path = Path::new(std::ffi::OsStr::from_bytes(b"r\xf6om.instgs"));
        let mut field = PathField::default();
        field.give(path);
        assert_eq!(field.path().as_deref(), Some(path));
        field.text.push('x');
        assert_eq!(field.path(), Some(format!("{}x", path.display()).into()));
    }
}
