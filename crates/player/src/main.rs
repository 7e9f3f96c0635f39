//! The player: see `instgs_vk::player` and `instgs_vk::cli`.

use std::process::ExitCode;

fn main() -> ExitCode {
    // Mesa's CPU driver reads its settings from the environment when it is loaded.
    // SAFETY: nothing has started a thread yet.
    unsafe { instgs_vk::cli::choose_lavapipe_width() };
    instgs_vk::cli::player_main()
}
