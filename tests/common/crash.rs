//! Programs that are killed at random moments, and what they may leave behind.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use instgs_vk::math::rng::Rng;

/// Number of disturbances: that of the environment variable INSTGS_CRASHES, else `few`.
pub(crate) fn rounds(few: usize) -> usize {
    std::env::var("INSTGS_CRASHES").ok().and_then(|n| n.parse().ok()).unwrap_or(few)
}

/// How a program ended that was to be killed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// It was killed.
    Killed,
    /// It was faster.
    Finished,
}

/// Starts a program and kills it after a random part of `within`.
pub(crate) fn kill_within(command: &mut Command, within: Duration, rng: &mut Rng) -> End {
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let until = Instant::now() + within.mul_f64(rng.uniform());
    while Instant::now() < until {
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success(), "it was not killed, and ends with {status}");
            return End::Finished;
        }
        std::thread::sleep(Duration::from_millis(1).min(until - Instant::now().min(until)));
    }
    // Fails if it has just ended.
    let _ = child.kill();
    match child.wait().unwrap().code() {
        None => End::Killed,
        Some(0) => End::Finished,
        Some(code) => panic!("it was not killed, and ends with code {code}"),
    }
}

/// Runs a program to its end, which must be a good one; how long it took.
pub(crate) fn run_whole(command: &mut Command) -> Duration {
    let start = Instant::now();
    let output = command.stdin(Stdio::null()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    start.elapsed()
}

/// Temporary files below a folder.
pub(crate) fn temporaries(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(temporaries(&path));
        } else if entry.file_name().to_string_lossy().starts_with(".instgs-") {
            found.push(path);
        }
    }
    found
}
