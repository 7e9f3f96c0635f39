//! Files that are written as a whole or not at all.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use tempfile::NamedTempFile;

use crate::{IoError, read_bytes};

/// Prefix of the names of [`locked_temporary`]'s files; a killed process may leave one behind.
pub(crate) const TEMPORARY_PREFIX: &str = ".instgs-";

/// Writes a file atomically, so that readers see either the old content or all of the new: into a temporary file in the
/// same folder, which is then renamed. On failure the old file is unchanged and the temporary file is removed. The first file
/// that a process writes into a folder also removes the temporary files that killed processes left there.
///
/// A link stays, and the file that it leads to is replaced. What is no file (a pipe, a terminal, another device) is written into
/// as it comes: there is nothing to rename over.
///
/// # Errors
/// The folder does not exist or refuses the file, `write` fails, or the disk is full.
pub fn atomic_write(path: &Path, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), IoError> {
    let fail = |error: &std::io::Error| IoError::os(path, "cannot write", error);
    let buffered = |out: &mut dyn Write| {
        let mut buffered = BufWriter::with_capacity(1 << 20, out);
        write(&mut buffered).and_then(|()| buffered.flush())
    };
    match Target::of(path).map_err(|e| fail(&e))? {
        Target::Stdout => buffered(&mut std::io::stdout()).map_err(|e| fail(&e)),
        Target::Stream => {
            File::options().append(true).open(path).and_then(|mut stream| buffered(&mut stream)).map_err(|e| fail(&e))
        }
        Target::File(target) => {
            let mut file = locked_temporary(&target, "")?;
            buffered(file.as_file_mut()).map_err(|e| fail(&e))?;
            file.persist(target).map_err(|e| fail(&e.error))?;
            Ok(())
        }
    }
}

/// The file that [`atomic_write`] would replace: where the path's links lead. The path itself if that is no file.
///
/// # Errors
/// More links than are followed, as in a circle.
pub fn replaced_file(path: &Path) -> Result<PathBuf, IoError> {
    match Target::of(path).map_err(|error| IoError::os(path, "cannot write", &error))? {
        Target::File(file) => Ok(file),
        Target::Stream | Target::Stdout => Ok(path.to_path_buf()),
    }
}

/// What a path that is written to stands for.
#[derive(Debug, PartialEq)]
enum Target {
    /// A file to replace or to make: where links lead to.
    File(PathBuf),
    /// Something that takes bytes and has none of its own, or a file that is open already and may be written to by others.
    Stream,
    /// The process's own standard output.
    Stdout,
}

/// Folders of the files that this process has open.
const OWN_OPEN_FILES: [&str; 3] = ["/dev/fd", "/proc/self/fd", "/proc/thread-self/fd"];
/// Links that are followed from one path, as many as Linux follows.
const MOST_LINKS: usize = 40;

impl Target {
    /// Follows the links of a path.
    ///
    /// # Errors
    /// More links than are followed, as in a circle.
    fn of(path: &Path) -> std::io::Result<Self> {
        let mut at = path.to_path_buf();
        for _ in 0..MOST_LINKS {
            // Open files, by their numbers: a link to standard output is one, too.
            let folder = at.parent().unwrap_or(Path::new(""));
            if folder == Path::new("/dev/fd") || (folder.starts_with("/proc") && folder.ends_with("fd")) {
                let is_own = OWN_OPEN_FILES.iter().any(|own| folder == Path::new(own));
                let is_stdout = is_own && at.file_name() == Some("1".as_ref());
                return Ok(if is_stdout { Self::Stdout } else { Self::Stream });
            }
            let Ok(to) = fs::read_link(&at) else {
                let is_stream = fs::metadata(&at).is_ok_and(|there| !there.is_file() && !there.is_dir());
                return Ok(if is_stream { Self::Stream } else { Self::File(at) });
            };
            at = at.parent().unwrap_or(Path::new("")).join(to);
        }
        Err(std::io::Error::other("too many links lead from one to the next"))
    }
}

/// A new, empty temporary file beside `path`, which becomes that file by [`NamedTempFile::persist`] and is removed if it does
/// not. `ending` is that of its name, for programs that go by it (".mp4", say), or empty: then nobody who lists a folder takes it
/// for a photo or a scene.
///
/// It is locked while it is open. Other processes remove files of this kind that nobody has locked, so it must stay open until
/// it has its name: [`NamedTempFile::into_temp_path`] ends the lock, and [`atomic_write`] to its path puts another file there,
/// which is not locked. On Windows a lock also keeps other programs from writing. All that write into a folder must see each
/// other's locks: not so on network file systems whose locks are local to a machine.
///
/// # Errors
/// The folder does not exist or refuses the file.
pub fn locked_temporary(path: &Path, ending: &str) -> Result<NamedTempFile, IoError> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    sweep_once(folder);
    locked_in(folder, ending).map_err(|error| IoError::os(path, "cannot write", &error))
}

/// A new temporary file in a folder, locked.
fn locked_in(folder: &Path, ending: &str) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(TEMPORARY_PREFIX).suffix(ending);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The process's umask is applied, as for any new file; the crate's default is owner-only.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    loop {
        let file = builder.tempfile_in(folder)?;
        let is_locked = match file.as_file().try_lock() {
            Ok(()) => true,
            // Another process sweeps the folder and has taken this file for one that was left behind.
            Err(TryLockError::WouldBlock) => false,
            // The file system has no locks, so `sweep` gets none either and leaves the file.
            Err(TryLockError::Error(_)) => return Ok(file),
        };
        // Gone: swept before it was locked.
        if is_locked && file.path().exists() {
            return Ok(file);
        }
    }
}

/// Removes a file if there is one.
///
/// # Errors
/// The system refuses.
pub fn remove_if_there(path: &Path) -> Result<(), IoError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(IoError::os(path, "cannot remove", &e)),
        _ => Ok(()),
    }
}

/// Copies a file of moderate size, so that readers of the target see its old content or all of the new.
///
/// # Errors
/// The source cannot be read, or the target cannot be written.
pub fn copy_file(from: &Path, to: &Path) -> Result<(), IoError> {
    let bytes = read_bytes(from)?;
    atomic_write(to, |out| out.write_all(&bytes))
}

/// Removes what killed processes left in a folder, the first time that this process writes into it.
fn sweep_once(folder: &Path) {
    static SWEPT: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    let is_first = SWEPT.lock().unwrap_or_else(PoisonError::into_inner).insert(folder.to_path_buf());
    if is_first {
        sweep(folder);
    }
}

/// Removes temporary files that no process holds. Whatever cannot be removed stays: the file to be written matters, not these.
fn sweep(folder: &Path) {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let temporary = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(TEMPORARY_PREFIX));
    for entry in temporary.filter(|entry| entry.metadata().is_ok_and(|data| data.is_file())) {
        let path = entry.path();
        // The lock is held until the file is removed: see `locked_in`.
        if let Ok(file) = File::open(&path)
            && file.try_lock().is_ok()
        {
            let _ = fs::remove_file(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_there_is_removed_already() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a");
        std::fs::write(&path, "x")?;
        remove_if_there(&path)?;
        remove_if_there(&path)?;
        assert!(!path.exists());
        // A folder is no file: that is an error, which names it.
        assert!(remove_if_there(folder.path()).is_err_and(|e| e.to_string().contains("cannot remove")));
        Ok(())
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_temporary() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x.bin");
        atomic_write(&path, |w| w.write_all(b"old"))?;
        let failed = atomic_write(&path, |w| {
            w.write_all(b"half")?;
            Err(std::io::Error::other("disk full"))
        });
        assert!(failed.is_err_and(|e| e.to_string().contains("disk full")));
        assert_eq!(fs::read(&path)?, b"old");
        assert_eq!(fs::read_dir(folder.path())?.count(), 1);
        Ok(())
    }

    /// Links to files that are there, and to one that is not.
    #[test]
    #[cfg(unix)]
    fn links_stay_and_their_files_are_written() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        fs::create_dir(folder.path().join("big"))?;
        let (link, target) = (folder.path().join("link"), folder.path().join("big/file"));
        std::os::unix::fs::symlink("big/file", &link)?;
        for content in [b"new", b"old"] {
            atomic_write(&link, |out| out.write_all(content))?;
            assert_eq!((link.is_symlink(), fs::read(&target)?), (true, content.to_vec()));
        }
        assert_eq!(fs::read_dir(folder.path())?.count() + fs::read_dir(folder.path().join("big"))?.count(), 3);
        // Over two links, of which the second leads nowhere yet, and round in a circle.
        let at = |name: &str| folder.path().join(name);
        for (from, to) in [("one", "two"), ("two", "three"), ("round", "and"), ("and", "round")] {
            std::os::unix::fs::symlink(to, at(from))?;
        }
        atomic_write(&at("one"), |out| out.write_all(b"through"))?;
        assert_eq!(
            (at("one").is_symlink(), at("two").is_symlink(), fs::read(at("three"))?),
            (true, true, b"through".into())
        );
        let refused = atomic_write(&at("round"), |out| out.write_all(b"x")).map_err(|e| e.to_string());
        assert!(refused.is_err_and(|text| text.contains("too many links")) && at("round").is_symlink());
        Ok(())
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn standard_output_is_no_file_to_replace() -> Result<(), Box<dyn std::error::Error>> {
        for name in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"] {
            assert_eq!(Target::of(Path::new(name))?, Target::Stdout, "{name}");
        }
        for name in ["/dev/stderr", "/dev/fd/2", "/dev/null", "/proc/1/fd/1"] {
            assert_eq!(Target::of(Path::new(name))?, Target::Stream, "{name}");
        }
        for name in ["a/b", "/dev/fd/3/scene.ply"] {
            assert_eq!(Target::of(Path::new(name))?, Target::File(name.into()));
        }
        Ok(())
    }

    #[test]
    #[cfg(unix)]
    fn a_pipe_gets_the_bytes_and_stays_a_pipe() -> Result<(), Box<dyn std::error::Error>> {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir()?;
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status()?.success());
        // Through a link as well, as those in /dev/fd are.
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&pipe, &link)?;
        for path in [&pipe, &link] {
            let read = std::thread::scope(|scope| {
                let reader = scope.spawn(|| fs::read(&pipe));
                let written = atomic_write(path, |out| out.write_all(b"bytes"));
                (written, reader.join())
            });
            read.0?;
            assert_eq!(read.1.map_err(|_| "the reader panicked")??, b"bytes");
        }
        assert!(fs::symlink_metadata(&pipe)?.file_type().is_fifo() && link.is_symlink());
        assert_eq!(fs::read_dir(folder.path())?.count(), 2);
        Ok(())
    }

    /// Of a dead process, of one that still writes, and one that is another program's.
    #[test]
    fn what_a_killed_process_left_is_removed() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = |name: &str| folder.path().join(name);
        fs::write(path(".instgs-dead"), "")?;
        let held = File::create(path(".instgs-held"))?;
        held.try_lock()?;
        fs::write(path(".other"), "")?;
        atomic_write(&path("x.bin"), |w| w.write_all(b"x"))?;
        let mut left: Vec<_> = fs::read_dir(folder.path())?.flatten().map(|entry| entry.file_name()).collect();
        left.sort();
        assert_eq!(left, [".instgs-held", ".other", "x.bin"]);
        Ok(())
    }

    /// What other programs write into is locked as long as it is open, whoever sweeps.
    #[test]
    #[cfg(unix)]
    fn a_temporary_file_stays_while_it_is_open() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x.mp4");
        let file = locked_temporary(&path, ".mp4")?;
        let name = file.path().file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        assert!(name.starts_with(TEMPORARY_PREFIX) && name.ends_with(".mp4"), "{name}");
        assert_eq!(file.path().parent(), Some(folder.path()));
        // Another program writes by the name.
        fs::write(file.path(), "film")?;
        sweep(folder.path());
        file.persist(&path).map_err(|e| e.error)?;
        assert_eq!(fs::read(&path)?, b"film");
        let closed = locked_temporary(&path, "")?.into_temp_path();
        sweep(folder.path());
        assert!(!closed.exists(), "nobody holds its lock");
        let none = locked_temporary(&folder.path().join("none/x.mp4"), ".mp4").err().map(|e| e.to_string());
        assert!(none.is_some_and(|text| text.contains("x.mp4: cannot write: ")));
        Ok(())
    }

    /// A file is swept before it is locked, or the other way round, never in between: none is lost.
    #[test]
    fn files_are_written_while_others_sweep() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let done = std::sync::atomic::AtomicBool::new(false);
        let done = &done;
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| {
                    while !done.load(std::sync::atomic::Ordering::Relaxed) {
                        sweep(folder.path());
                    }
                });
            }
            let written = (0..500).try_for_each(|k: u32| {
                atomic_write(&folder.path().join("x.bin"), |out| out.write_all(&k.to_le_bytes()))
            });
            done.store(true, std::sync::atomic::Ordering::Relaxed);
            written
        })?;
        assert_eq!(fs::read(folder.path().join("x.bin"))?, 499u32.to_le_bytes());
        assert_eq!(fs::read_dir(folder.path())?.count(), 1);
        Ok(())
    }
}
