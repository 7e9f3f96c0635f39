//! The files of a run that are written before its first step, and again if someone removes them.

use std::path::Path;
use std::time::Duration;

use instgs_io::{IoError, RunFolder, atomic_write, run_folder};

/// How often, and after what pause, a file is written again into a folder that is being removed at the same time. A folder of many
/// files takes a moment to go.
const REMOVAL: (u32, Duration) = (20, Duration::from_millis(10));

/// Does something with the folder that may be missing, or vanish meanwhile: then it is made again, and the work is done again.
///
/// # Errors
/// The system still refuses after some tries: the last reason.
pub(super) fn with_folder<T>(folder: &Path, work: impl Fn() -> Result<T, IoError>) -> Result<T, IoError> {
    let once = || run_folder::create(folder).and_then(|()| work());
    let (tries, pause) = REMOVAL;
    for _ in 1..tries {
        if let Ok(done) = once() {
            return Ok(done);
        }
        std::thread::sleep(pause);
    }
    once()
}

/// The run folder and the text of its configuration.
#[derive(Clone, Debug)]
pub(super) struct RunFiles {
    folder: RunFolder,
    config: String,
}

impl RunFiles {
    /// The files of a run with this configuration; none is written yet.
    pub(super) fn new(folder: RunFolder, config: String) -> Self {
        Self { folder, config }
    }

    /// Makes the folder and writes the configuration.
    ///
    /// # Errors
    /// The system refuses.
    pub(super) fn write(&self) -> Result<(), IoError> {
        self.folder.create()?;
        atomic_write(&self.folder.config(), |out| out.write_all(self.config.as_bytes()))
    }

    /// Writes the files again if they are gone: hours of training are worth more than the folder that they were to be put in.
    /// Returns a line for the user if it was so.
    ///
    /// # Errors
    /// The system refuses.
    pub(super) fn restore(&self) -> Result<Option<String>, IoError> {
        let what = match (self.folder.path().is_dir(), self.folder.config().is_file()) {
            (true, true) => return Ok(None),
            (true, false) => "its config.toml was removed during the training and is written again",
            (false, _) => {
                "was removed during the training and is made again, without what stages and checkpoints had left there"
            }
        };
        with_folder(self.folder.path(), || self.write())?;
        Ok(Some(format!("{}: {what}", self.folder.path().display())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder that someone removes again and again while it is written into.
    #[test]
    fn a_folder_may_vanish_meanwhile() -> Result<(), Box<dyn std::error::Error>> {
        let above = tempfile::tempdir()?;
        let folder = above.path().join("run");
        let remove = {
            let folder = folder.clone();
            std::thread::spawn(move || {
                let until = std::time::Instant::now() + Duration::from_millis(100);
                while std::time::Instant::now() < until {
                    let _ = std::fs::remove_dir_all(&folder);
                }
            })
        };
        let files = RunFiles::new(RunFolder::new(&folder), "steps = 3\n".into());
        while !remove.is_finished() {
            files.restore()?;
        }
        remove.join().map_err(|_| "the other thread has failed")?;
        files.restore()?;
        assert_eq!(std::fs::read(folder.join("config.toml"))?, b"steps = 3\n");
        Ok(())
    }

    #[test]
    fn what_is_removed_is_written_again() -> Result<(), Box<dyn std::error::Error>> {
        let above = tempfile::tempdir()?;
        let folder = RunFolder::new(above.path().join("a/run"));
        let files = RunFiles::new(folder.clone(), "steps = 3\n".into());
        files.write()?;
        assert_eq!(files.restore()?, None);
        std::fs::remove_file(folder.config())?;
        assert!(files.restore()?.is_some_and(|line| line.contains("config.toml")));
        std::fs::remove_dir_all(above.path().join("a"))?;
        assert!(files.restore()?.is_some_and(|line| line.contains("made again")));
        assert_eq!(std::fs::read_to_string(folder.config())?, "steps = 3\n");
        Ok(())
    }
}
