//! The explanation of each key: the comments of the files that hold the defaults.

use super::keys::Takes;
use super::load::Configuration;

/// A key with what a user should know of it.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyText {
    /// Dotted name, for instance `rates.means`.
    pub name: &'static str,
    /// What the key is for: the comment above it, or the one of the keys right above it, on one line.
    pub text: String,
    /// The comment of its section, on one line; empty if there is none.
    pub section: String,
    /// Default value as TOML.
    pub default: String,
    /// Type and range of its values.
    pub takes: Takes,
}

/// A line `name = value` of a file, with the comments that explain it.
struct Entry {
    name: String,
    value: String,
    text: String,
    section: String,
}

/// Every key of a configuration with its explanation, in the order of [`Configuration::keys`]. A key that no file of
/// [`Configuration::defaults`] has is left out; tests see to it that there is none.
pub fn explain<C: Configuration>() -> Vec<KeyText> {
    let entries: Vec<Entry> = C::defaults().iter().flat_map(|(_, text)| entries(text)).collect();
    let explained = |key: super::keys::Key| {
        let entry = entries.iter().find(|entry| entry.name == key.name)?;
        Some(KeyText {
            name: key.name,
            text: entry.text.clone(),
            section: entry.section.clone(),
            default: entry.value.clone(),
            takes: key.takes,
        })
    };
    C::keys().into_iter().filter_map(explained).collect()
}

/// The lines `name = value` of a file. A comment belongs to all keys below it, up to the next comment, blank line or
/// section.
fn entries(file: &str) -> Vec<Entry> {
    let (mut out, mut prefix, mut section) = (Vec::new(), String::new(), String::new());
    // The comment above, and whether keys have followed it.
    let (mut text, mut is_used) = (String::new(), false);
    for line in file.lines().map(str::trim) {
        if let Some(words) = line.strip_prefix('#') {
            if std::mem::take(&mut is_used) {
                text.clear();
            }
            let gap = if text.is_empty() { "" } else { " " };
            text = format!("{text}{gap}{}", words.trim());
        } else if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            prefix = format!("{name}.");
            section = std::mem::take(&mut text);
        } else if let Some((name, value)) = line.split_once(" = ") {
            is_used = true;
            out.push(Entry {
                name: format!("{prefix}{name}"),
                value: value.into(),
                text: text.clone(),
                section: section.clone(),
            });
        } else {
            text.clear();
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrainConfig;

    #[test]
    fn comments_belong_to_the_keys_below_them() {
        let file = "# About the file.\n\n# First,\n# of two.\na = 1\nb = \"x\"\n# Third.\nc = 2\n\n# A part.\n[s]\nd = 3\n# E.\ne = 4";
        let found: Vec<[String; 4]> = entries(file).into_iter().map(|e| [e.name, e.value, e.text, e.section]).collect();
        let want = [
            ["a", "1", "First, of two.", ""],
            ["b", "\"x\"", "First, of two.", ""],
            ["c", "2", "Third.", ""],
            ["s.d", "3", "", "A part."],
            ["s.e", "4", "E.", "A part."],
        ];
        assert_eq!(found, want.map(|row| row.map(String::from)));
    }

    #[test]
    fn every_key_of_the_trainer_is_explained() {
        let texts = explain::<TrainConfig>();
        assert_eq!(texts.len(), TrainConfig::keys().len());
        for text in texts {
            assert!(text.text.len() + text.section.len() > 20, "{} has no explanation", text.name);
        }
    }
}
