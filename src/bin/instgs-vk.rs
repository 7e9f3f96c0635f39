//! The command-line program: see `instgs_vk::cli`.

use std::process::ExitCode;

fn main() -> ExitCode {
    // Before anything starts a thread: Mesa's CPU driver reads its settings from the environment once.
    instgs_vk::cli::choose_lavapipe_width();
    instgs_vk::cli::main()
}
