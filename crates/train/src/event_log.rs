//! The log of a run, `RUN/events.jsonl`: one event per line.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};

use super::events::{Event, EventSink};
use super::run_files::with_folder;
use instgs_io::{IoError, Place, atomic_write, is_at, read_bytes};

/// Appends events to a file. A checkpoint relies on the events before it, and they are in the file only once
/// [`Self::flush`] was called: flush before a checkpoint is written. Events other than steps and overflows flush by
/// themselves. If the file or its folder is removed meanwhile, it is then written anew as it was.
#[derive(Debug)]
pub struct EventLog {
    path: PathBuf,
    file: BufWriter<File>,
    /// Whether the file was written anew since [`Self::was_restored`] was last asked.
    restored: bool,
}

/// What became of the lines of a log that was resumed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Kept {
    /// The events that were kept, in order.
    pub events: Vec<Event>,
    /// Number of events dropped that are of later steps, which will happen again.
    pub later: usize,
    /// Number of lines dropped that are not events, such as a last line cut off by a crash.
    pub damaged: usize,
}

impl EventLog {
    /// Starts an empty log.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(path: &Path) -> Result<Self, IoError> {
        atomic_write(path, |_| Ok(()))?;
        Self::open(path)
    }

    /// Opens the log of a run that continues after `step` finished steps: keeps the lines for which `choose` gives true, in
    /// order and unchanged, and drops the rest. `choose` gets all events, and gives one value for each. A missing file counts as
    /// empty.
    ///
    /// # Errors
    /// The file cannot be read or written; then it is unchanged.
    pub fn resume(
        path: &Path,
        step: u64,
        choose: &mut dyn FnMut(&[Event]) -> Vec<bool>,
    ) -> Result<(Self, Kept), IoError> {
        let bytes = if path.exists() { read_bytes(path)? } else { Vec::new() };
        let (mut whole, mut events, mut kept) = (Vec::new(), Vec::new(), Kept::default());
        for line in lines(&bytes) {
            match line.event() {
                Some(event) => {
                    whole.push(line.bytes);
                    events.push(event);
                }
                None => kept.damaged += 1,
            }
        }
        let chosen = choose(&events);
        let mut text = Vec::with_capacity(bytes.len());
        for ((line, event), stays) in whole.into_iter().zip(events).zip(chosen) {
            if stays {
                text.extend_from_slice(line);
                text.push(b'\n');
                kept.events.push(event);
            } else {
                kept.later += usize::from(event.step() > step);
            }
        }
        if text != bytes {
            atomic_write(path, |out| out.write_all(&text))?;
        }
        Ok((Self::open(path)?, kept))
    }

    /// Opens the file, which may be missing, to append to it.
    fn open(path: &Path) -> Result<Self, IoError> {
        // Read again where it is removed.
        let file = OpenOptions::new().read(true).append(true).create(true).open(path);
        let file = file.map_err(|e| IoError::os(path, "cannot write", &e))?;
        Ok(Self { path: path.into(), file: BufWriter::new(file), restored: false })
    }

    /// Writes the file anew if its path no longer leads to it.
    fn restore(&mut self) -> Result<(), IoError> {
        if is_at(self.file.get_ref(), &self.path) {
            return Ok(());
        }
        let fail = |e: std::io::Error| IoError::os(&self.path, "was removed and cannot be written anew", &e);
        let (mut bytes, mut file) = (Vec::new(), self.file.get_ref());
        file.rewind().and_then(|()| file.read_to_end(&mut bytes)).map_err(fail)?;
        // Opened as it was written: a file that vanishes in between must not begin anew without its lines.
        let file = with_folder(self.path.parent().unwrap_or(Path::new(".")), || {
            atomic_write(&self.path, |out| out.write_all(&bytes))?;
            let file = OpenOptions::new().read(true).append(true).open(&self.path);
            file.map_err(|e| IoError::os(&self.path, "cannot write", &e))
        })?;
        (self.file, self.restored) = (BufWriter::new(file), true);
        Ok(())
    }

    /// True once after the file was removed and written anew.
    pub fn was_restored(&mut self) -> bool {
        std::mem::take(&mut self.restored)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl EventSink for EventLog {
    fn event(&mut self, event: &Event) -> Result<(), IoError> {
        let mut line = serde_json::to_vec(event).map_err(|e| IoError::new(&self.path, e.to_string()))?;
        line.push(b'\n');
        self.file.write_all(&line).map_err(|e| IoError::os(&self.path, "cannot write", &e))?;
        match event {
            Event::Step { .. } | Event::Overflow { .. } => Ok(()),
            _ => self.flush(),
        }
    }

    /// Hands all events to the operating system, so that they survive the end of this process.
    fn flush(&mut self) -> Result<(), IoError> {
        self.file.flush().map_err(|e| IoError::os(&self.path, "cannot write", &e))?;
        self.restore()
    }
}

/// The events of a log. A last line without a line break is ignored: its writer was stopped, or is still writing.
///
/// # Errors
/// The file cannot be read, or a line in it is not an event.
pub fn read_events(path: &Path) -> Result<Vec<Event>, IoError> {
    let bytes = read_bytes(path)?;
    let whole = lines(&bytes).filter(|line| line.whole).enumerate();
    whole
        .map(|(i, line)| {
            let error =
                || IoError::new(path, "is not an event of this version of instgs-vk").at(Place::Line(i as u64 + 1));
            line.event().ok_or_else(error)
        })
        .collect()
}

struct Line<'a> {
    bytes: &'a [u8],
    /// Whether the line ends with a line break.
    whole: bool,
}

impl Line<'_> {
    fn event(&self) -> Option<Event> {
        // A cut line may be valid by chance, so only lines with a line break count.
        if self.whole { serde_json::from_slice(self.bytes).ok() } else { None }
    }
}

fn lines(bytes: &[u8]) -> impl Iterator<Item = Line<'_>> {
    bytes.split_inclusive(|&b| b == b'\n').map(|line| match line.strip_suffix(b"\n") {
        Some(bytes) => Line { bytes, whole: true },
        None => Line { bytes: line, whole: false },
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    type Test = Result<(), Box<dyn std::error::Error>>;

    fn step(step: u64) -> Event {
        let (loss, l1, ssim, psnr) = (0.25 / step as f64, 0.125, 0.5, 20.0);
        Event::Step {
            step,
            loss,
            mean_loss: None,
            view_losses: vec![(3, 0.25)],
            l1,
            ssim,
            psnr,
            gaussians: 7,
            steps_per_second: 3.5,
            seconds: 0.1,
        }
    }

    fn sample() -> Vec<Event> {
        let mut events: Vec<Event> = (1..=6).map(step).collect();
        events.insert(3, Event::Checkpoint { step: 3, path: "checkpoints/x".into() });
        events
    }

    fn write(path: &Path, events: &[Event]) -> Result<(), IoError> {
        let mut log = EventLog::create(path)?;
        events.iter().try_for_each(|e| log.event(e))?;
        log.flush()
    }

    #[test]
    fn what_is_logged_is_read() -> Test {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("events.jsonl");
        write(&path, &sample())?;
        assert_eq!(read_events(&path)?, sample());
        Ok(())
    }

    fn resume(path: &Path, step: u64) -> Result<(EventLog, Kept), IoError> {
        EventLog::resume(path, step, &mut |events| events.iter().map(|event| event.step() <= step).collect())
    }

    /// For every length that a crash may leave: a log resumed at step 3 and continued equals that of a run without the
    /// crash, except for events that had not reached the file.
    #[test]
    fn resuming_a_log_cut_anywhere_leaves_whole_events_up_to_the_step() -> Test {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("events.jsonl");
        write(&path, &sample())?;
        let bytes = fs::read(&path)?;
        for length in 0..=bytes.len() {
            fs::write(&path, &bytes[..length])?;
            let lines = bytes[..length].iter().filter(|&&b| b == b'\n').count();
            let (mut log, kept) = resume(&path, 3)?;
            log.event(&step(4))?;
            drop(log);
            let mut want = sample()[..lines.min(4)].to_vec();
            want.push(step(4));
            assert_eq!(read_events(&path)?, want, "cut at {length}");
            let cut = usize::from(length > 0 && bytes[length - 1] != b'\n');
            let events = sample()[..lines.min(4)].to_vec();
            assert_eq!(kept, Kept { events, later: lines.saturating_sub(4), damaged: cut });
        }
        Ok(())
    }

    #[test]
    fn a_checkpoint_flushes_and_a_step_does_not() -> Test {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("events.jsonl");
        let mut log = EventLog::create(&path)?;
        log.event(&step(1))?;
        assert!(read_events(&path)?.is_empty());
        log.event(&Event::Checkpoint { step: 1, path: "x".into() })?;
        assert_eq!(read_events(&path)?.len(), 2);
        Ok(())
    }

    #[cfg(unix)]
    #[test]
    fn a_removed_log_is_written_anew() -> Test {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("run/events.jsonl");
        fs::create_dir(folder.path().join("run"))?;
        let checkpoint = |step| Event::Checkpoint { step, path: "x".into() };
        let mut log = EventLog::create(&path)?;
        let mut want = Vec::new();
        for (number, removed) in [Some(path.clone()), None, Some(folder.path().join("run"))].into_iter().enumerate() {
            let events = [step(number as u64 + 1), checkpoint(number as u64 + 1)];
            match &removed {
                Some(path) if path.is_dir() => fs::remove_dir_all(path)?,
                Some(path) => fs::remove_file(path)?,
                None => {}
            }
            events.iter().try_for_each(|event| log.event(event))?;
            want.extend(events);
            assert_eq!((log.was_restored(), log.was_restored()), (removed.is_some(), false));
            assert_eq!(read_events(&path)?, want);
        }
        Ok(())
    }

    #[test]
    fn a_foreign_line_is_an_error_with_its_number() -> Test {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("events.jsonl");
        write(&path, &sample()[..1])?;
        fs::write(&path, [fs::read(&path)?, b"{\"event\":\"x\"}\n".to_vec()].concat())?;
        let error = read_events(&path).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains("line 2"), "{error}");
        let (_, kept) = resume(&path, 9)?;
        assert_eq!((kept.events.len(), kept.later, kept.damaged), (1, 0, 1));
        assert_eq!(read_events(&path)?.len(), 1);
        Ok(())
    }
}
