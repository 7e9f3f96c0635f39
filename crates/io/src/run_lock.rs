//! The lock of a run folder: one process at a time trains in it.
//!
//! The lock is the operating system's, on the file `.lock` of the folder, so that it ends with the process however that
//! ends. The file says who holds it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

use crate::IoError;
use crate::run_folder::create;

/// Name of the lock's file.
const NAME: &str = ".lock";
/// More than the file has.
const MOST_TEXT: u64 = 256;

/// The right to write into a run folder, until it is dropped.
#[derive(Debug)]
pub struct RunLock {
    file: File,
    path: PathBuf,
    /// The folder, if it was made for the lock.
    made: Option<PathBuf>,
}

impl RunLock {
    /// Takes the lock of a folder, which is made if necessary.
    ///
    /// # Errors
    /// Another process holds it, which is named; or the system refuses.
    pub fn take(folder: &Path) -> Result<Self, IoError> {
        let made = (!folder.exists()).then(|| folder.to_owned());
        create(folder)?;
        let path = folder.join(NAME);
        let fail = |e: std::io::Error| IoError::os(&path, "cannot lock", &e);
        loop {
            let mut file =
                OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).map_err(fail)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(held(folder, &mut file)),
                // Some network file systems have no locks.
                Err(TryLockError::Error(e)) if e.kind() == std::io::ErrorKind::Unsupported => {}
                Err(TryLockError::Error(e)) => return Err(fail(e)),
            }
            // Its last holder removes the file: then this one is nobody's, and the next is to be locked.
            if !is_at(&file, &path) {
                continue;
            }
            file.set_len(0).map_err(fail)?;
            file.rewind().map_err(fail)?;
            write!(file, "process {}", std::process::id()).and_then(|()| file.flush()).map_err(fail)?;
            return Ok(Self { file, path, made });
        }
    }
}

impl Drop for RunLock {
    fn drop(&mut self) {
        // Removed while it is locked. Nothing depends on its removal.
        if cfg!(unix) {
            let _ = std::fs::remove_file(&self.path);
        }
        let _ = self.file.unlock();
        if let Some(folder) = &self.made {
            // Fails, as it should, if the run left anything.
            let _ = std::fs::remove_dir(folder);
        }
    }
}

fn held(folder: &Path, file: &mut File) -> IoError {
    let mut text = String::new();
    // Where locks are mandatory the text cannot be read.
    let who = match Read::by_ref(file).take(MOST_TEXT).read_to_string(&mut text) {
        Ok(_) if text.starts_with("process ") => text,
        _ => "another process".into(),
    };
    let error = IoError::new(folder, format!("{who} is training in this folder"));
    error.advise("wait until it is done, or stop it, or choose another folder")
}

/// True if the path leads to this open file, and not to another or nowhere. Only Unix lets an open file be removed.
#[cfg(unix)]
pub fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let id = |metadata: std::fs::Metadata| (metadata.dev(), metadata.ino());
    matches!((file.metadata().map(id), std::fs::metadata(path).map(id)), (Ok(a), Ok(b)) if a == b)
}

/// True: elsewhere an open file is not removed.
#[cfg(not(unix))]
pub fn is_at(_: &File, _: &Path) -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_holder() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let run = folder.path().join("a/run");
        let lock = RunLock::take(&run)?;
        let refused = RunLock::take(&run).expect_err("is held").to_string();
        assert!(refused.contains(&format!("process {}", std::process::id())), "{refused}");
        drop(lock);
        // A run that left nothing leaves no folder.
        assert!(!run.exists());
        std::fs::create_dir_all(&run)?;
        // What a killed process left is no lock.
        std::fs::write(run.join(NAME), "process 1")?;
        drop(RunLock::take(&run)?);
        assert!(run.is_dir() && std::fs::read_dir(&run)?.count() == usize::from(!cfg!(unix)));
        Ok(())
    }
}
