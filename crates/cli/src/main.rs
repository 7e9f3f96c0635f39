//! The program `instgs-vk`: see [`instgs_cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    // Mesa's CPU driver reads its settings from the environment when it is loaded.
    // SAFETY: no other thread has been started yet.
    unsafe { instgs_console::choose_lavapipe_width() };
    instgs_cli::main()
}
