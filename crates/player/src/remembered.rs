//! What is remembered from session to session: the files that were opened or saved lately, and how the panels are set up.

use std::path::{Path, PathBuf};

use egui::{Context, ThemePreference};
use instgs_io::json::{read_json, write_json};
use serde::{Deserialize, Serialize};

use super::hud::{Hud, OpenPanels};

/// Number of files remembered.
const MOST: usize = 8;
/// The folder of both files, instead of the user's usual one.
const FOLDER: &str = "INSTGS_PLAYER_CONFIG";
/// Sizes of panels that are taken from a file, which anyone may have edited.
const SIZES: std::ops::RangeInclusive<f32> = 0.5..=4.0;

/// The user's file of a name; none for scripts and benchmarks, which are `alone` and leave nothing behind, unless a folder was named
/// for it.
fn file_of_user(name: &str, alone: bool) -> Option<PathBuf> {
    let named = std::env::var_os(FOLDER).map(PathBuf::from);
    let usual = || {
        let home = || std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".config"));
        let configs = std::env::var_os("XDG_CONFIG_HOME").or_else(|| std::env::var_os("APPDATA"));
        configs.map(PathBuf::from).or_else(home).map(|folder| folder.join("instgs-player"))
    };
    let folder = named.or_else(|| if alone { None } else { usual() })?;
    Some(folder.join(name))
}

/// Reads one of the user's files; what is not there, or cannot be understood, is as it is for a new user.
fn read<T: for<'a> Deserialize<'a> + Default>(file: Option<&Path>) -> T {
    file.filter(|file| file.exists()).and_then(|file| read_json(file).ok()).unwrap_or_default()
}

/// Writes one of the user's files. One that cannot be written is no reason to disturb anyone.
fn write(file: &Path, value: &impl Serialize) {
    if let Some(folder) = file.parent() {
        let _ = std::fs::create_dir_all(folder);
    }
    let _ = write_json(file, value);
}

/// The list of files, the last one first.
#[derive(Default)]
pub(super) struct Recent {
    files: Vec<PathBuf>,
    list: Option<PathBuf>,
}

impl Recent {
    /// Reads the list of the user; `alone` is true if nothing is to be remembered.
    pub(super) fn open(alone: bool) -> Self {
        let list = file_of_user("recent.json", alone);
        Self { files: read(list.as_deref()), list }
    }

    /// The files, the last one first.
    pub(super) fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// Puts a file first.
    pub(super) fn note(&mut self, path: &Path) {
        let Some(list) = &self.list else { return };
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
        self.files.retain(|other| *other != path);
        self.files.insert(0, path);
        self.files.truncate(MOST);
        // The others have no place in JSON, and are remembered for this session.
        let texts: Vec<&str> = self.files.iter().filter_map(|path| path.to_str()).collect();
        write(list, &texts);
    }
}

/// The colours of the panels.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Theme {
    /// As the system has them.
    #[default]
    System,
    Light,
    Dark,
}

impl From<ThemePreference> for Theme {
    fn from(theme: ThemePreference) -> Self {
        match theme {
            ThemePreference::System => Self::System,
            ThemePreference::Light => Self::Light,
            ThemePreference::Dark => Self::Dark,
        }
    }
}

impl From<Theme> for ThemePreference {
    fn from(theme: Theme) -> Self {
        match theme {
            Theme::System => Self::System,
            Theme::Light => Self::Light,
            Theme::Dark => Self::Dark,
        }
    }
}

/// How the panels are set up.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(default)]
struct Setup {
    theme: Theme,
    /// Size of the panels; 1 as made.
    size: f32,
    panels: OpenPanels,
    grid: bool,
    axes: bool,
}

impl Default for Setup {
    fn default() -> Self {
        Self { theme: Theme::System, size: 1.0, panels: OpenPanels::default(), grid: false, axes: true }
    }
}

impl Setup {
    fn of(ctx: &Context, hud: &Hud) -> Self {
        let passing = OpenPanels::default();
        let panels = OpenPanels { help: passing.help, open: passing.open, save_as: passing.save_as, ..hud.panels };
        let theme = ctx.options(|options| options.theme_preference).into();
        Self { theme, size: ctx.zoom_factor(), panels, grid: hud.grid, axes: hud.axes }
    }
}

/// The setup of the panels, and its file.
#[derive(Default)]
pub(super) struct Remembered {
    setup: Setup,
    file: Option<PathBuf>,
}

impl Remembered {
    /// Reads the setup of the user; `alone` is true if nothing is to be remembered.
    pub(super) fn open(alone: bool) -> Self {
        let file = file_of_user("settings.json", alone);
        Self { setup: read(file.as_deref()), file }
    }

    /// Sets up the panels of a new context.
    pub(super) fn restore(&self, ctx: &Context, hud: &mut Hud) {
        let Setup { theme, size, panels, grid, axes } = self.setup.clone();
        ctx.set_theme(theme);
        ctx.set_zoom_factor(size.clamp(*SIZES.start(), *SIZES.end()));
        (hud.panels, hud.grid, hud.axes) = (panels, grid, axes);
    }

    /// Remembers the setup, and writes it if it has changed.
    pub(super) fn note(&mut self, ctx: &Context, hud: &Hud) {
        let setup = Setup::of(ctx, hud);
        if setup == self.setup {
            return;
        }
        self.setup = setup;
        if let Some(file) = &self.file {
            write(file, &self.setup);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_path_that_is_no_text_keeps_no_other_out_of_the_list() {
        use std::os::unix::ffi::OsStrExt;
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("recent.json");
        let [a, b] = ["a.ply", "b.ply"].map(|name| folder.path().join(name));
        let odd = folder.path().join(std::ffi::OsStr::from_bytes(b"\xf6.ply"));
        let mut recent = Recent { files: Vec::new(), list: Some(list.clone()) };
        [&a, &odd, &b].into_iter().for_each(|path| recent.note(path));
        assert_eq!(recent.files(), [b.clone(), odd, a.clone()]);
        assert_eq!(read::<Vec<PathBuf>>(Some(&list)), [b, a]);
    }

    #[test]
    fn what_was_set_up_is_there_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("new").join("settings.json");
        let opened = || Remembered { setup: read(Some(&file)), file: Some(file.clone()) };
        let (ctx, mut hud) = (Context::default(), Hud::new(true));
        let mut first = opened();
        first.restore(&ctx, &mut hud);
        first.note(&ctx, &hud);
        assert!(!file.exists(), "nothing has changed");
        ctx.set_theme(egui::Theme::Light);
        (hud.panels.scene, hud.panels.help, hud.grid) = (true, true, true);
        first.note(&ctx, &hud);
        let (ctx, mut hud) = (Context::default(), Hud::new(true));
        opened().restore(&ctx, &mut hud);
        assert_eq!(ctx.options(|options| options.theme_preference), ThemePreference::Light);
        assert!(hud.panels.scene && hud.grid && hud.axes && !hud.panels.help, "help is not remembered");
        std::fs::write(&file, "{\"size\": \"large\"}").unwrap();
        opened().restore(&ctx, &mut hud);
        assert!(!hud.panels.scene, "a file that makes no sense counts as none");
    }
}
