//! Paths from a block's folder to the files of the whole data set, which are not copied.

use std::path::{Component, Path, PathBuf};

use instgs_io::IoError;

/// The path that leads from `folder` to `target`, both absolute and without links or dots; `target` itself if they have
/// nothing in common.
pub(crate) fn relative_path(folder: &Path, target: &Path) -> PathBuf {
    let (from, to): (Vec<Component<'_>>, Vec<Component<'_>>) =
        (folder.components().collect(), target.components().collect());
    let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    if shared == 0 {
        return target.into();
    }
    let up = std::iter::repeat_n(Component::ParentDir, from.len() - shared);
    up.chain(to[shared..].iter().copied()).collect()
}

/// The same as text with slashes, as `transforms.json` wants it.
pub(crate) fn relative_text(folder: &Path, target: &Path) -> String {
    let path = relative_path(folder, target);
    if path.is_absolute() || cfg!(not(windows)) {
        return path.to_string_lossy().into_owned();
    }
    path.to_string_lossy().replace('\\', "/")
}

/// An absolute path without its dots: each pair of dots takes back the folder before it.
pub(crate) fn without_dots(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(out.pop()),
            Component::CurDir => {}
            part => out.push(part),
        }
    }
    out
}

/// The folder of a data set.
pub(crate) struct DataFolder<'a> {
    /// The path that the user gave: those of the files that a reader names begin with it.
    given: &'a Path,
    /// Absolute, without links or dots.
    pub(crate) real: PathBuf,
}

impl<'a> DataFolder<'a> {
    /// The data set in the folder at a path, which may be a link.
    ///
    /// # Errors
    /// No folder is there, or the system does not let it be read.
    pub(crate) fn new(given: &'a Path) -> Result<Self, IoError> {
        let real = std::fs::canonicalize(given).map_err(|e| IoError::os(given, "cannot find", &e))?;
        Ok(Self { given, real })
    }

    /// An absolute path of a file that the reader of the data set names; the file may be missing. Within the data set the path
    /// below its folder stays as it is, links included: views, and so their masks, are named by it. The path of a file outside
    /// has no links and no dots.
    ///
    /// # Errors
    /// The file's folder cannot be found.
    pub(crate) fn path_of(&self, file: &Path) -> Result<PathBuf, IoError> {
        let absolute = std::path::absolute(self.given).unwrap_or_else(|_| self.given.into());
        let named = [self.given, absolute.as_path(), self.real.as_path()];
        let below = named.into_iter().find_map(|folder| file.strip_prefix(folder).ok());
        // A path with two dots may lead out of the folder.
        match below.filter(|below| below.components().all(|part| matches!(part, Component::Normal(_)))) {
            Some(below) => Ok(self.real.join(below)),
            None => real_path(file),
        }
    }
}

/// An absolute path without links or dots of a file that may be missing, in a folder that exists.
///
/// # Errors
/// Its folder cannot be found.
fn real_path(file: &Path) -> Result<PathBuf, IoError> {
    let folder = match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    // A photo that is missing in a folder that is missing, too, is the reader's to report.
    let real = std::fs::canonicalize(folder).or_else(|_| std::path::absolute(folder));
    let real = real.map_err(|e| IoError::os(folder, "cannot find", &e))?;
    Ok(real.join(file.file_name().unwrap_or_default()))
}

/// Makes `link` a link to a folder, unless it is one already.
///
/// # Errors
/// The system refuses, or something else has that name.
pub(crate) fn link_folder(target: &Path, link: &Path) -> Result<(), IoError> {
    if std::fs::read_link(link).is_ok_and(|there| there == target) {
        return Ok(());
    }
    #[cfg(unix)]
    let made = std::os::unix::fs::symlink(target, link);
    #[cfg(windows)]
    let made = std::os::windows::fs::symlink_dir(target, link);
    made.map_err(|e| {
        let error = IoError::os(link, &format!("cannot link to {}", target.display()), &e);
        error.advise("give another folder with --out, on a disk that has links")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn paths_lead_up_and_down_again() {
        let path = |from: &str, to: &str| relative_text(Path::new(from), Path::new(to));
        assert_eq!(path("/a/out/block_00", "/a/data/images/x.png"), "../../data/images/x.png");
        assert_eq!(path("/a/data/out/b", "/a/data/x.png"), "../../x.png");
        assert_eq!(path("/a", "/a/b/c"), "b/c");
        assert_eq!(path("/a/b", "/z/c"), "../../z/c");
        assert_eq!(without_dots(Path::new("/a/b/../../z/./c")), Path::new("/z/c"));
    }

    #[test]
    #[cfg(unix)]
    fn only_links_outside_of_the_data_set_are_followed() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let real = std::fs::canonicalize(folder.path())?;
        for below in ["disk/cam_a", "disk/set/images/own"] {
            std::fs::create_dir_all(real.join(below))?;
        }
        // The data set is a link, a folder of its photos is one, and so is one beside it.
        let links = [("disk/set", "data"), ("../../cam_a", "disk/set/images/left"), ("disk/cam_a", "beside")];
        for (target, link) in links {
            std::os::unix::fs::symlink(target, real.join(link))?;
        }
        let given = real.join("data");
        let data = DataFolder::new(&given)?;
        let path = |file: &str| data.path_of(&given.join(file));
        assert_eq!(data.real, real.join("disk/set"));
        assert_eq!(path("images/left/1.png")?, real.join("disk/set/images/left/1.png"));
        assert_eq!(path("images/own/missing.png")?, real.join("disk/set/images/own/missing.png"));
        // A file that names its photos by the real folder; and photos outside.
        assert_eq!(data.path_of(&data.real.join("images/left/1.png"))?, real.join("disk/set/images/left/1.png"));
        assert_eq!(path("../cam_a/1.png")?, real.join("disk/cam_a/1.png"));
        assert_eq!(data.path_of(&real.join("beside/1.png"))?, real.join("disk/cam_a/1.png"));
        assert!(DataFolder::new(&real.join("none")).is_err());
        Ok(())
    }
}
