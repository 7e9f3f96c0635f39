//! The only module that writes to the terminal.

use std::borrow::Cow;
use std::fmt::Display;
use std::io::{ErrorKind, IsTerminal, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::CliError;
use instgs_io::{IoError, atomic_write};

/// Writes bytes that are worthless unless they are whole.
fn to_stdout(bytes: &[u8]) -> Result<(), CliError> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(bytes).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(CliError::msg(format!("cannot write all of the output ({error}): make room, or write it elsewhere")))
        }
        _ => Ok(()),
    }
}

/// Number of progress lines of a task with many steps, without a terminal.
const PROGRESS_LINES: u64 = 10;

/// The bar that the terminal shows: a process has one terminal, so all printers step around the same bar.
static SHOWN_BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Reports to stdout, warnings and errors to stderr. A closed stream is no error: `instgs-vk ... | head` just ends.
#[derive(Clone, Copy, Debug)]
pub struct Printer {
    json_on_stdout: bool,
}

impl Printer {
    /// With `json_on_stdout`, stdout carries the JSON report and nothing else.
    pub fn new(json_on_stdout: bool) -> Self {
        Self { json_on_stdout }
    }

    /// Prints a line of the report in text form; dropped if stdout is for JSON.
    pub fn line(&self, text: impl Display) {
        if !self.json_on_stdout {
            beside_the_bar(|| writeln!(std::io::stdout().lock(), "{}", plain(&text.to_string())));
        }
    }

    /// Writes the bytes of a file to stdout, as they are: a script for a shell, which may hold tabs.
    ///
    /// # Errors
    /// Not all of it can be written.
    pub fn file(&self, bytes: &[u8]) -> Result<(), CliError> {
        to_stdout(bytes)
    }

    /// Writes the JSON report to stdout.
    ///
    /// # Errors
    /// Not all of it can be written, or the report is none of JSON's values.
    pub fn json(&self, report: &impl serde::Serialize) -> Result<(), CliError> {
        to_stdout(&json_bytes(report)?)
    }

    /// Writes the JSON report to a file.
    pub fn json_file(&self, path: &Path, report: &impl serde::Serialize) -> Result<(), CliError> {
        let bytes = json_bytes(report)?;
        Ok(atomic_write(path, |out| out.write_all(&bytes))?)
    }

    /// Prints a warning: the command continues.
    pub fn warning(&self, text: impl Display) {
        beside_the_bar(|| writeln!(std::io::stderr().lock(), "warning: {}", plain(&one_line(&text))));
    }

    /// Prints the error of a failed command on one line.
    pub fn error(&self, error: &CliError) {
        beside_the_bar(|| writeln!(std::io::stderr().lock(), "error: {}", plain(&one_line(error))));
    }

    /// Progress over `total` steps: a bar on a terminal, plain lines elsewhere.
    pub fn progress(&self, what: &'static str, total: u64) -> Progress {
        let bar = std::io::stderr().is_terminal().then(|| {
            // The message is cut where the line ends, so that it stays one line.
            let style = ProgressStyle::with_template("{prefix} {bar:16} {pos}/{len}, {eta} left  {wide_msg}").ok();
            let bar = ProgressBar::new(total).with_prefix(what);
            bar.enable_steady_tick(Duration::from_millis(200));
            let bar = style.map_or(bar.clone(), |style| bar.with_style(style));
            *SHOWN_BAR.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar.clone());
            bar
        });
        Progress { printer: *self, what, total, done: 0, bar }
    }
}

/// Progress of one long task; see [`Printer::progress`].
pub struct Progress {
    printer: Printer,
    what: &'static str,
    total: u64,
    done: u64,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// Records that one more step is done.
    pub fn step(&mut self, text: impl Display) {
        self.advance_to(self.done + 1, text);
    }

    /// Records that `done` steps are done in total.
    pub fn advance_to(&mut self, done: u64, text: impl Display) {
        let before = std::mem::replace(&mut self.done, done);
        match &self.bar {
            Some(bar) => {
                bar.set_message(plain(&text.to_string()).into_owned());
                bar.set_position(done);
            }
            None if self.worth_a_line(before) => {
                let line = format!("{} {}/{} {text}", self.what, self.done, self.total);
                self.printer.line(line.trim_end());
            }
            None => {}
        }
    }
}

impl Progress {
    /// True if the step is printed: every step of a few, about ten lines of many.
    fn worth_a_line(&self, before: u64) -> bool {
        let part = |done: u64| done * PROGRESS_LINES / self.total.max(1);
        self.total <= 2 * PROGRESS_LINES || part(self.done) > part(before)
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
            *SHOWN_BAR.lock().unwrap_or_else(PoisonError::into_inner) = None;
        }
    }
}

/// Writes a line where the bar is, which is drawn again below it. A closed stream is no error.
fn beside_the_bar(write: impl FnOnce() -> std::io::Result<()>) {
    let bar = SHOWN_BAR.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let _ = match bar {
        Some(bar) => bar.suspend(write),
        None => write(),
    };
}

fn json_bytes(report: &impl serde::Serialize) -> Result<Vec<u8>, CliError> {
    let mut bytes = serde_json::to_vec_pretty(report)
        .map_err(|e| IoError::new(Path::new("report"), format!("is not valid JSON: {e}")))?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// The text with control characters as escapes, for names in files may hold what a terminal obeys. Line breaks stay.
fn plain(text: &str) -> Cow<'_, str> {
    let is_raw = |c: char| c.is_control() && c != '\n';
    if !text.contains(is_raw) {
        return Cow::Borrowed(text);
    }
    text.chars()
        .map(|c| if is_raw(c) { c.escape_unicode().to_string() } else { c.to_string() })
        .collect::<String>()
        .into()
}

/// The text on one line: messages of drivers and other crates may contain line breaks.
fn one_line(text: &impl Display) -> String {
    text.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}
