//! A folder of checkpoints: file names, the newest intact one, and removal of old ones.

use std::fs;
use std::path::{Path, PathBuf};

use super::Checkpoint;
use crate::IoError;
use crate::atomic::TEMPORARY_PREFIX;

const PREFIX: &str = "step_";
const SUFFIX: &str = ".safetensors";

/// Number of intact checkpoints that a run keeps by default: the newest, and one in reserve in case that is damaged.
pub const KEEP: usize = 2;

/// File name of the state after `step` steps, for instance `step_0000500.safetensors`.
pub fn file_name(step: u64) -> String {
    format!("{PREFIX}{step:07}{SUFFIX}")
}

/// The newest intact checkpoint of a folder.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Newest {
    /// The checkpoint and its file; `None` if there is none.
    pub found: Option<(PathBuf, Checkpoint)>,
    /// Why newer files cannot be used. They are not removed.
    pub skipped: Vec<IoError>,
}

/// Writes `checkpoint` into `folder` (created if missing) under the name of its step; returns the path.
///
/// # Errors
/// The folder or the file cannot be written.
pub fn save(folder: &Path, checkpoint: &Checkpoint) -> Result<PathBuf, IoError> {
    fs::create_dir_all(folder).map_err(|e| IoError::os(folder, "cannot make the folder", &e))?;
    let path = folder.join(file_name(checkpoint.step));
    checkpoint.write(&path)?;
    Ok(path)
}

/// True if the folder has a file that is named as a checkpoint, intact or not; false for a missing one.
pub fn is_any_in(folder: &Path) -> bool {
    list(folder).is_ok_and(|files| !files.is_empty())
}

/// Finds and reads the newest intact checkpoint. A missing folder counts as empty.
///
/// # Errors
/// The folder cannot be listed. Damaged files are not errors: see [`Newest::skipped`].
pub fn latest(folder: &Path) -> Result<Newest, IoError> {
    let mut newest = Newest::default();
    for (step, path) in list(folder)? {
        match read_step(step, &path) {
            Ok(checkpoint) => {
                newest.found = Some((path, checkpoint));
                break;
            }
            Err(error) => newest.skipped.push(error),
        }
    }
    Ok(newest)
}

/// Removes all but the newest `keep` intact checkpoints (at least one), and temporary files of killed processes.
/// Damaged files do not count, and are removed if they are older than those kept. Only the process that writes into the
/// folder may call this. Returns the removed paths.
///
/// # Errors
/// The folder cannot be listed, or a file cannot be removed.
pub fn prune(folder: &Path, keep: usize) -> Result<Vec<PathBuf>, IoError> {
    let mut whole = 0;
    let mut surplus = temporaries(folder)?;
    for (step, path) in list(folder)? {
        if whole >= keep.max(1) {
            surplus.push(path);
        } else if read_step(step, &path).is_ok() {
            whole += 1;
        }
    }
    for path in &surplus {
        fs::remove_file(path).map_err(|e| IoError::os(path, "cannot remove", &e))?;
    }
    Ok(surplus)
}

fn read_step(step: u64, path: &Path) -> Result<Checkpoint, IoError> {
    let checkpoint = Checkpoint::read(path)?;
    if checkpoint.step == step {
        Ok(checkpoint)
    } else {
        let what = format!("holds step {}, which differs from its name", checkpoint.step);
        Err(IoError::new(path, what).advise(format!("rename it to {}", file_name(checkpoint.step))))
    }
}

/// Step and path of all files that are named like checkpoints, newest first.
fn list(folder: &Path) -> Result<Vec<(u64, PathBuf)>, IoError> {
    let mut found = Vec::new();
    for name in names(folder)? {
        let digits = name.strip_prefix(PREFIX).and_then(|n| n.strip_suffix(SUFFIX));
        if let Some(step) = digits.and_then(|d| d.parse::<u64>().ok()).filter(|&step| file_name(step) == name) {
            found.push((step, folder.join(name)));
        }
    }
    found.sort_by_key(|(step, _)| std::cmp::Reverse(*step));
    Ok(found)
}

fn temporaries(folder: &Path) -> Result<Vec<PathBuf>, IoError> {
    let names = names(folder)?;
    Ok(names.iter().filter(|n| n.starts_with(TEMPORARY_PREFIX)).map(|n| folder.join(n)).collect())
}

/// Names of all files; empty if the folder does not exist.
fn names(folder: &Path) -> Result<Vec<String>, IoError> {
    let fail = |e: std::io::Error| IoError::os(folder, "cannot list", &e);
    let entries = match fs::read_dir(folder) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(fail)?,
    };
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry.map_err(fail)?;
        if entry.file_type().map_err(fail)?.is_file() {
            names.extend(entry.file_name().into_string());
        }
    }
    names.sort();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::super::tests::sample;
    use super::*;

    type Test = Result<(), Box<dyn std::error::Error>>;

    fn step_of(newest: &Newest) -> Option<u64> {
        newest.found.as_ref().map(|(_, c)| c.step)
    }

    fn damage(path: &Path) -> std::io::Result<()> {
        let mut bytes = fs::read(path)?;
        if let Some(last) = bytes.last_mut() {
            *last ^= 1;
        }
        fs::write(path, bytes)
    }

    #[test]
    fn names_sort_by_step_even_beyond_seven_digits() -> Test {
        let folder = tempfile::tempdir()?;
        assert_eq!(file_name(500), "step_0000500.safetensors");
        for step in [9_999_999, 10_000_000, 2] {
            save(folder.path(), &sample(step))?;
        }
        fs::write(folder.path().join("step_99999999999.safetensors.bak"), "x")?;
        fs::write(folder.path().join("step_x.safetensors"), "x")?;
        fs::create_dir(folder.path().join(file_name(20_000_000)))?;
        let newest = latest(folder.path())?;
        assert_eq!((step_of(&newest), newest.skipped.len()), (Some(10_000_000), 0));
        assert_eq!(step_of(&latest(&folder.path().join("none"))?), None);
        Ok(())
    }

    #[test]
    fn whatever_is_left_of_the_newest_the_one_before_is_found() -> Test {
        let folder = tempfile::tempdir()?;
        save(folder.path(), &sample(1))?;
        let path = save(folder.path(), &sample(2))?;
        let bytes = fs::read(&path)?;
        for length in 0..bytes.len() {
            fs::write(&path, &bytes[..length])?;
            let newest = latest(folder.path())?;
            assert_eq!((step_of(&newest), newest.skipped.len()), (Some(1), 1), "cut at {length}");
        }
        assert!(path.exists());
        fs::write(&path, &bytes)?;
        assert_eq!(step_of(&latest(folder.path())?), Some(2));
        Ok(())
    }

    #[test]
    fn a_file_under_another_steps_name_is_skipped_with_advice() -> Test {
        let folder = tempfile::tempdir()?;
        let path = save(folder.path(), &sample(1))?;
        fs::rename(path, folder.path().join(file_name(9)))?;
        let newest = latest(folder.path())?;
        assert_eq!(step_of(&newest), None);
        assert!(newest.skipped[0].to_string().contains("rename it to step_0000001.safetensors"));
        Ok(())
    }

    #[test]
    fn pruning_keeps_the_newest_whole_ones() -> Test {
        let folder = tempfile::tempdir()?;
        for step in 1..=6 {
            save(folder.path(), &sample(step))?;
        }
        [3, 6].iter().try_for_each(|&step| damage(&folder.path().join(file_name(step))))?;
        fs::write(folder.path().join(".instgs-abc"), "left by a crash")?;
        fs::write(folder.path().join("notes.txt"), "the user's")?;
        let removed = prune(folder.path(), 2)?;
        assert_eq!(removed.len(), 4, "{removed:?}");
        let want = ["notes.txt".into(), file_name(4), file_name(5), file_name(6)];
        assert_eq!(names(folder.path())?, want);
        assert_eq!(prune(folder.path(), 0)?, [folder.path().join(file_name(4))]);
        assert_eq!(step_of(&latest(folder.path())?), Some(5));
        Ok(())
    }
}
