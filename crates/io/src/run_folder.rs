//! The folder of a run: the one place that knows what its files are called.

use std::path::{Path, PathBuf, is_separator};

use super::IoError;

/// Paths of the files that a run leaves, stage by stage; none of them need exist. The folder of the command `segment` is
/// laid out in the same way. The plain cloud that an instanced scene is made of has a run folder of its own inside of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// The run in folder `path`.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into() }
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes the folder and those above it.
    ///
    /// # Errors
    /// The system refuses.
    pub fn create(&self) -> Result<(), IoError> {
        create(&self.path)
    }

    /// The resolved configuration: with it a folder counts as that of a run.
    pub fn config(&self) -> PathBuf {
        self.path.join("config.toml")
    }

    /// What happened during training, one event a line.
    pub fn events(&self) -> PathBuf {
        self.path.join("events.jsonl")
    }

    /// The folder of checkpoints.
    pub fn checkpoints(&self) -> PathBuf {
        self.path.join("checkpoints")
    }

    /// Facts about a training that is done; written last, so that with it the training counts as done.
    pub fn facts(&self) -> PathBuf {
        self.path.join("trained.json")
    }

    /// The exposures of the training photos, of a run that learned them.
    pub fn exposures(&self) -> PathBuf {
        self.path.join("exposures.json")
    }

    /// The plain cloud.
    pub fn point_cloud(&self) -> PathBuf {
        self.path.join("point_cloud.ply")
    }

    /// The trained scene.
    pub fn scene(&self) -> PathBuf {
        self.path.join("scene.instgs")
    }

    /// The run that trains the plain cloud of an instanced scene.
    pub fn plain_cloud_run(&self) -> Self {
        Self::new(self.path.join("vanilla"))
    }

    /// The folder of masks that a run makes for itself.
    pub fn masks(&self) -> PathBuf {
        self.path.join("masks")
    }

    /// The cameras of the training views, in the order that the consensus and the labels count by.
    pub fn cameras(&self) -> PathBuf {
        self.path.join("cameras.json")
    }

    /// Which object every mask shows.
    pub fn consensus(&self) -> PathBuf {
        self.path.join("consensus.json")
    }

    /// The object of every Gaussian of the plain cloud.
    pub fn labels(&self) -> PathBuf {
        self.path.join("labels.safetensors")
    }

    /// Which objects are alike, and their poses.
    pub fn groups(&self) -> PathBuf {
        self.path.join("groups.json")
    }

    /// How each object was registered; written after [`Self::groups`].
    pub fn registration(&self) -> PathBuf {
        self.path.join("registration.json")
    }

    /// The scene of templates and instances that the joint phase starts from.
    pub fn initial_scene(&self) -> PathBuf {
        self.path.join("initial.instgs")
    }

    /// What became of masks, objects and groups on the way to [`Self::initial_scene`].
    pub fn prepared(&self) -> PathBuf {
        self.path.join("prepared.json")
    }

    /// The report for programs.
    pub fn report(&self) -> PathBuf {
        self.path.join("report.json")
    }

    /// The report for people.
    pub fn page(&self) -> PathBuf {
        self.path.join("report.html")
    }

    /// The sheet of all views with their masks.
    pub fn review(&self) -> PathBuf {
        self.path.join("review.html")
    }

    /// The folder of pictures of what the stages from masks to templates did.
    pub fn stage_pictures(&self) -> PathBuf {
        self.path.join("stages")
    }

    /// The folder of rendered test views.
    pub fn renders(&self) -> PathBuf {
        self.path.join("renders")
    }

    /// The name of a file that shows that a run has been here, if there is one.
    pub fn trace_of_run(&self) -> Option<String> {
        let run = self.plain_cloud_run();
        first_there([self.config(), run.path, self.checkpoints(), self.report(), self.point_cloud()])
    }

    /// Fails if the folder holds a run, which a new one would mix with.
    ///
    /// # Errors
    /// It does; the text names a file that shows it.
    pub fn expect_no_run(&self) -> Result<(), IoError> {
        let Some(found) = self.trace_of_run() else { return Ok(()) };
        let error = IoError::new(&self.path, format!("holds a run already ({found})"));
        Err(error.advise("continue it with --resume, or choose another folder"))
    }

    /// The name of a file that shows that a scene was segmented or trained here, if there is one.
    pub fn trace_of_segments(&self) -> Option<String> {
        let run = self.plain_cloud_run();
        // The folder of a run of INRIA's program has a cameras.json, too.
        let of_others = self.path.join("cfg_args");
        first_there([self.labels(), self.events(), run.path, self.checkpoints(), self.report(), of_others])
    }
}

/// Makes a folder and those above it.
///
/// # Errors
/// The system refuses.
pub fn create(folder: &Path) -> Result<(), IoError> {
    std::fs::create_dir_all(folder).map_err(|e| IoError::new(folder, format!("cannot create the folder: {e}")))
}

/// Makes the folder that a file is to lie in, and those above it: before the work whose result it will hold.
///
/// # Errors
/// The file is a folder, or the system refuses.
pub fn create_for(file: &Path) -> Result<(), IoError> {
    if file.is_dir() || ends_in_separator(file) {
        return Err(IoError::new(file, "is a folder").advise("name a file in it"));
    }
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => create(folder),
        _ => Ok(()),
    }
}

/// True of names of folders, as people write them.
pub fn ends_in_separator(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().last().is_some_and(|&last| is_separator(char::from(last)))
}

fn first_there(paths: impl IntoIterator<Item = PathBuf>) -> Option<String> {
    let found = paths.into_iter().find(|path| path.exists())?;
    Some(found.file_name()?.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_no_file_to_write() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let message = |file: &Path| create_for(file).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(message(folder.path()).ends_with("is a folder; name a file in it"), "{}", message(folder.path()));
        assert!(message(&folder.path().join("new/")).contains("is a folder"));
        assert_eq!(message(&folder.path().join("new/scene.ply")), "");
        assert!(folder.path().join("new").is_dir());
        Ok(())
    }

    #[test]
    fn what_a_run_left_is_noticed() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let run = RunFolder::new(folder.path().join("runs/a"));
        assert_eq!((run.trace_of_run(), run.trace_of_segments()), (None, None));
        run.create()?;
        std::fs::write(run.config(), "")?;
        assert_eq!((run.trace_of_run(), run.trace_of_segments()), (Some("config.toml".into()), None));
        run.plain_cloud_run().create()?;
        assert_eq!(run.trace_of_segments(), Some("vanilla".into()));
        std::fs::write(run.labels(), "")?;
        assert_eq!(run.trace_of_segments(), Some("labels.safetensors".into()));
        let of_others = RunFolder::new(folder.path().join("others"));
        of_others.create()?;
        std::fs::write(of_others.path().join("cfg_args"), "")?;
        assert_eq!(of_others.trace_of_segments(), Some("cfg_args".into()));
        Ok(())
    }
}
