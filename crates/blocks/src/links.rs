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

/// An absolute path without links or dots of a file that may be missing, in a folder that exists.
///
/// # Errors
/// Its folder cannot be found.
pub(crate) fn real_path(file: &Path) -> Result<PathBuf, IoError> {
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
    }
}
