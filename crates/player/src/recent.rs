//! The files that were opened or saved lately, remembered from session to session.

use std::path::{Path, PathBuf};

use instgs_io::json::{read_json, write_json};

/// Number of files remembered.
const MOST: usize = 8;
/// The folder of the list, instead of the user's usual one.
const FOLDER: &str = "INSTGS_PLAYER_CONFIG";

/// The list, the last file first.
#[derive(Default)]
pub(super) struct Recent {
    files: Vec<PathBuf>,
    /// Where the list is kept; none for scripts and benchmarks, which leave nothing behind.
    list: Option<PathBuf>,
}

impl Recent {
    /// Reads the list of the user; empty if there is none. `alone` is true if nothing is to be remembered, unless a folder was
    /// named for it.
    pub(super) fn open(alone: bool) -> Self {
        let named = std::env::var_os(FOLDER).map(PathBuf::from);
        let usual = || {
            let home = || std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".config"));
            let configs = std::env::var_os("XDG_CONFIG_HOME").or_else(|| std::env::var_os("APPDATA"));
            configs.map(PathBuf::from).or_else(home).map(|folder| folder.join("instgs-player"))
        };
        let folder = named.or_else(|| if alone { None } else { usual() });
        let list = folder.map(|folder| folder.join("recent.json"));
        let files = list.as_deref().filter(|list| list.exists()).and_then(|list| read_json(list).ok());
        Self { files: files.unwrap_or_default(), list }
    }

    /// The files, the last one first.
    pub(super) fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// Puts a file first. A list that cannot be written is no reason to disturb anyone.
    pub(super) fn note(&mut self, path: &Path) {
        let Some(list) = &self.list else { return };
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        self.files.retain(|other| *other != path);
        self.files.insert(0, path);
        self.files.truncate(MOST);
        if let Some(folder) = list.parent() {
            let _ = std::fs::create_dir_all(folder);
        }
        let _ = write_json(list, &self.files);
    }
}
