//! Runs workers. When one ends before its time, its last batch is done again by another that writes each input to a file before it
//! is read: what is then in the file is the input at fault.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use flate2::Crc;

use crate::inputs::BATCH;
use crate::worker::{Done, noted};

/// After so many inputs at fault a target is left.
const MOST_FAULTS: usize = 3;
/// Most characters of a worker's message that are given on.
const MOST_CHARACTERS: usize = 300;

/// How long, and within which limits.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Seed of all inputs.
    pub seed: u64,
    /// Number of batches of a target.
    pub batches: u64,
    /// Time for a target, if it is limited.
    pub time: Option<Duration>,
    /// Longest time for one input.
    pub time_per_input: Duration,
    /// Most memory that a reader may have allocated at once, MiB.
    pub memory_mib: u64,
}

/// An input that broke a promise.
#[derive(Clone, Debug)]
pub struct Fault {
    /// What happened, one line.
    pub what: String,
    /// Where the input was saved; `None` if it did not happen again.
    pub input: Option<PathBuf>,
}

/// What came of a target.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Inputs, times and memory.
    pub done: Done,
    /// Wall time, seconds.
    pub seconds: f64,
    /// The inputs at fault, at most three.
    pub faults: Vec<Fault>,
}

/// Gives inputs to one target in processes of `program`, and saves those at fault in the folder `out`.
///
/// # Errors
/// A process cannot be started, or a file cannot be written.
pub fn run(program: &Path, target: &str, limits: &Limits, out: &Path) -> io::Result<Outcome> {
    let begin = Instant::now();
    let folder = tempfile::tempdir()?;
    let mut outcome = Outcome::default();
    let mut first = 0;
    while first < limits.batches && outcome.faults.len() < MOST_FAULTS {
        let left = limits.time.map(|time| time.saturating_sub(begin.elapsed()));
        if left == Some(Duration::ZERO) {
            break;
        }
        let start = Start { program, target, limits, folder: folder.path() };
        let ended = start.worker(first..limits.batches, left, None)?;
        if ended.status.success() {
            let done = fs::read(start.result()).and_then(|bytes| Ok(serde_json::from_slice::<Done>(&bytes)?))?;
            outcome.done.add(&done);
            break;
        }
        // A worker that dies before it begins leaves the note of the one before it.
        let own = noted(&start.progress()).filter(|batch| *batch >= first);
        let batch = own.ok_or_else(|| io::Error::other(start.refused(&ended)))?;
        outcome.done.inputs += (batch - first) * BATCH;
        outcome.faults.push(start.again(batch, &ended, out)?);
        first = batch + 1;
    }
    outcome.seconds = begin.elapsed().as_secs_f64();
    Ok(outcome)
}

/// How workers of a target are started.
struct Start<'a> {
    program: &'a Path,
    target: &'a str,
    limits: &'a Limits,
    folder: &'a Path,
}

impl Start<'_> {
    fn progress(&self) -> PathBuf {
        self.folder.join("progress")
    }

    fn result(&self) -> PathBuf {
        self.folder.join("result.json")
    }

    fn worker(&self, batches: std::ops::Range<u64>, time: Option<Duration>, keep: Option<&Path>) -> io::Result<Output> {
        let scratch = self.folder.join("scratch");
        fs::create_dir_all(&scratch)?;
        let mut command = Command::new(self.program);
        command.args(["worker", self.target]);
        let numbers = [
            ("--seed", self.limits.seed),
            ("--first", batches.start),
            ("--end", batches.end),
            ("--milliseconds-per-input", self.limits.time_per_input.as_millis() as u64),
            ("--memory", self.limits.memory_mib),
        ];
        for (flag, number) in numbers {
            command.args([flag, &number.to_string()]);
        }
        if let Some(time) = time {
            command.args(["--milliseconds", &time.as_millis().to_string()]);
        }
        for (flag, path) in [("--progress", self.progress()), ("--result", self.result()), ("--scratch", scratch)] {
            command.arg(flag).arg(path);
        }
        if let Some(keep) = keep {
            command.arg("--keep").arg(keep);
        }
        command.output()
    }

    /// Does a batch again that ended a worker, and saves the input at which it ends.
    fn again(&self, batch: u64, ended: &Output, out: &Path) -> io::Result<Fault> {
        let keep = self.folder.join("input");
        let again = self.worker(batch..batch + 1, None, Some(&keep))?;
        if again.status.success() {
            let what = format!("{} (batch {batch} of seed {}; not again)", said(ended), self.limits.seed);
            return Ok(Fault { what, input: None });
        }
        let bytes = fs::read(&keep)?;
        let mut crc = Crc::new();
        crc.update(&bytes);
        fs::create_dir_all(out)?;
        let saved = out.join(format!("{}-{:08x}.bin", self.target, crc.sum()));
        fs::write(&saved, bytes)?;
        Ok(Fault { what: said(&again), input: Some(saved) })
    }

    fn refused(&self, ended: &Output) -> String {
        format!("{}: the worker did not begin: {}", self.target, said(ended))
    }
}

/// How a worker ended, and its last words, as one line.
fn said(ended: &Output) -> String {
    let text = String::from_utf8_lossy(&ended.stderr);
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let words: String = line.chars().take(MOST_CHARACTERS).collect();
    format!("{}: {words}", ended.status)
}
