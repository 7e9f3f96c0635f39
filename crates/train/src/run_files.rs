//! The files of a run that are written before its first step, and again if someone removes them.

use instgs_io::{IoError, RunFolder, atomic_write};

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
        self.write()?;
        Ok(Some(format!("{}: {what}", self.folder.path().display())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
