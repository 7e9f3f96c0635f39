//! The program `instgs-evidence`: see [`instgs_evidence`].

use std::process::ExitCode;

fn main() -> ExitCode {
    // Mesa's CPU driver reads its settings from the environment when it is loaded.
    // SAFETY: no other thread has been started yet.
    unsafe { instgs_console::choose_lavapipe_width() };
    instgs_evidence::main()
}
