//! The process that gives inputs to one reader. It ends at the first input that breaks a promise, by the panic, by the limit of
//! memory, by the clock or by the end of the stack; which batch it was then stands in a file.

use std::fs::{self, File};
use std::io::{self, Seek, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::inputs::{BATCH, Batch};
use crate::{SeedError, Target};

/// Stack of the thread that reads, bytes: that of threads which are given none.
const STACK_BYTES: usize = 2 << 20;
/// Exit code after an input that took too long.
pub const TOO_LONG: i32 = 3;

/// What one process is to do.
#[derive(Clone, Debug)]
pub struct Job {
    /// Seed of all inputs.
    pub seed: u64,
    /// The batches, by number.
    pub batches: Range<u64>,
    /// No batch begins later.
    pub time: Option<Duration>,
    /// Longest time for one input.
    pub time_per_input: Duration,
    /// Gets the number of each batch before it begins.
    pub progress: PathBuf,
    /// Gets each input before it is read.
    pub keep: Option<PathBuf>,
    /// An empty folder to write into.
    pub scratch: PathBuf,
}

/// What a process, or several, have done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// Number of inputs.
    pub inputs: u64,
    /// Number of inputs that the reader accepted.
    pub accepted: u64,
    /// Time of the slowest input, seconds.
    pub slowest_seconds: f64,
    /// Most memory that was allocated at once, bytes.
    pub peak_bytes: u64,
}

impl Done {
    /// Adds what another process has done.
    pub fn add(&mut self, other: &Self) {
        self.inputs += other.inputs;
        self.accepted += other.accepted;
        self.slowest_seconds = self.slowest_seconds.max(other.slowest_seconds);
        self.peak_bytes = self.peak_bytes.max(other.peak_bytes);
    }
}

/// Gives the inputs of a job to a target's reader. `peak_bytes` tells the most memory that was allocated at once.
///
/// # Errors
/// A file that cannot be written, or seeds that cannot be made.
pub fn run(target: Target, job: &Job, peak_bytes: &dyn Fn() -> u64) -> Result<Done, SeedError> {
    let clock = Arc::new(Clock::new());
    watch(clock.clone(), job.time_per_input);
    let done = std::thread::scope(|scope| {
        let reader = std::thread::Builder::new().stack_size(STACK_BYTES);
        let reader = reader.spawn_scoped(scope, || read_all(&target, job, &clock))?;
        // A panic has been reported by its hook.
        reader.join().unwrap_or_else(|_| std::process::exit(101))
    })?;
    Ok(Done { peak_bytes: peak_bytes(), ..done })
}

fn read_all(target: &Target, job: &Job, clock: &Clock) -> Result<Done, SeedError> {
    let seeds = (target.seeds)()?;
    let mut progress = File::create(&job.progress)?;
    let mut done = Done::default();
    for number in job.batches.clone() {
        if job.time.is_some_and(|time| clock.start.elapsed() >= time) {
            break;
        }
        note(&mut progress, number)?;
        let mut batch = Batch::new(target, &seeds, job.seed, number);
        for _ in 0..BATCH {
            let input = batch.next_input();
            if let Some(keep) = &job.keep {
                fs::write(keep, &input)?;
            }
            let begin = Instant::now();
            clock.begins();
            let accepted = (target.read)(&input, &job.scratch);
            clock.ends();
            done.inputs += 1;
            done.slowest_seconds = done.slowest_seconds.max(begin.elapsed().as_secs_f64());
            if accepted {
                done.accepted += 1;
                batch.accepted(input);
            }
        }
    }
    Ok(done)
}

fn note(progress: &mut File, number: u64) -> io::Result<()> {
    progress.rewind()?;
    progress.write_all(&number.to_le_bytes())
}

/// The batch that a process was at.
pub fn noted(progress: &Path) -> Option<u64> {
    fs::read(progress).ok()?.first_chunk().map(|bytes| u64::from_le_bytes(*bytes))
}

/// When the current input began.
struct Clock {
    start: Instant,
    /// Milliseconds after the start, plus 1; 0 between inputs.
    began: AtomicU64,
}

impl Clock {
    fn new() -> Self {
        Self { start: Instant::now(), began: AtomicU64::new(0) }
    }

    fn now(&self) -> u64 {
        self.start.elapsed().as_millis() as u64 + 1
    }

    fn begins(&self) {
        self.began.store(self.now(), Ordering::Relaxed);
    }

    fn ends(&self) {
        self.began.store(0, Ordering::Relaxed);
    }
}

/// Ends the process when an input takes longer than `limit`.
fn watch(clock: Arc<Clock>, limit: Duration) {
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_millis(50));
            let began = clock.began.load(Ordering::Relaxed);
            if began > 0 && clock.now() - began > limit.as_millis() as u64 {
                let _ = writeln!(io::stderr(), "an input takes more than {} s", limit.as_secs_f64());
                std::process::exit(TOO_LONG);
            }
        }
    });
}
