//! Ctrl-C: the first asks the trainer to stop after the current step, the second ends the process.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// Exit code of a process that the second Ctrl-C ended: 128 + SIGINT, the shells' convention.
pub const EXIT_CODE: i32 = 130;

/// The process's only handler, or the reason why there is none.
static HANDLER: OnceLock<Result<Interrupt, InterruptError>> = OnceLock::new();

/// The Ctrl-C handler could not be installed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot listen to Ctrl-C, so a run could not be stopped without loss: {0}")]
pub struct InterruptError(String);

/// A request to stop, shared by all clones. The trainer polls it between steps, then writes a checkpoint and ends.
#[derive(Clone, Debug, Default)]
pub struct Interrupt {
    requested: Arc<AtomicBool>,
}

impl Interrupt {
    /// A request that is made only by [`Self::request`], for use without a terminal.
    pub fn new() -> Self {
        Self::default()
    }

    /// The request that Ctrl-C makes. The second Ctrl-C ends the process at once with [`EXIT_CODE`]. Every call in a
    /// process returns the same request, even after Ctrl-C.
    ///
    /// # Errors
    /// The system refuses the handler, or other code of this process already handles Ctrl-C.
    pub fn on_ctrl_c() -> Result<Self, InterruptError> {
        let install = || {
            let interrupt = Self::new();
            let handler = interrupt.clone();
            ctrlc::set_handler(move || {
                if handler.requested.swap(true, Ordering::SeqCst) {
                    std::process::exit(EXIT_CODE);
                }
            })
            .map_err(|e| InterruptError(e.to_string()))?;
            Ok(interrupt)
        };
        HANDLER.get_or_init(install).clone()
    }

    /// Asks the trainer to stop after the current step.
    pub fn request(&self) {
        self.requested.store(true, Ordering::SeqCst);
    }

    /// True once the trainer was asked to stop.
    pub fn requested(&self) -> bool {
        self.requested.load(Ordering::SeqCst)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_share_the_request_and_others_do_not() {
        let (one, other) = (Interrupt::new(), Interrupt::new());
        let clone = one.clone();
        assert!(!clone.requested());
        one.request();
        assert!(clone.requested() && !other.requested());
    }

    /// Environment variable that is set in the process started by [`ctrl_c_asks_first_and_kills_then`].
    #[cfg(unix)]
    const CHILD: &str = "INSTGS_TEST_INTERRUPT_CHILD";

    /// The child process: installs the handler twice and sends itself Ctrl-C twice.
    #[cfg(unix)]
    #[test]
    fn interrupted_child() {
        if std::env::var_os(CHILD).is_none() {
            return;
        }
        let wait = |until: &dyn Fn() -> bool| {
            (0..1000).any(|_| {
                std::thread::sleep(std::time::Duration::from_millis(10));
                until()
            })
        };
        let ctrl_c = || {
            let command = format!("kill -INT {}", std::process::id());
            std::process::Command::new("sh").args(["-c", &command]).status().is_ok_and(|s| s.success())
        };
        let first = Interrupt::on_ctrl_c().unwrap();
        let second = Interrupt::on_ctrl_c().unwrap();
        assert!(!first.requested());
        assert!(ctrl_c() && wait(&|| first.requested() && second.requested()), "the first Ctrl-C does not arrive");
        assert!(ctrl_c());
        wait(&|| false);
    }

    #[cfg(unix)]
    #[test]
    fn ctrl_c_asks_first_and_kills_then() -> std::io::Result<()> {
        let output = std::process::Command::new(std::env::current_exe()?)
            .args(["--exact", "interrupt::tests::interrupted_child", "--nocapture"])
            .env(CHILD, "1")
            .output()?;
        assert_eq!(output.status.code(), Some(EXIT_CODE), "{}", String::from_utf8_lossy(&output.stderr));
        Ok(())
    }
}
