//! The program as tests run it.

use assert_cmd::Command;

/// The program under test.
pub(crate) fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_instgs-vk"))
}

/// True, and said aloud, if tests that need a Vulkan device are not wanted.
#[allow(clippy::print_stderr, reason = "a skipped test must be heard")]
pub(crate) fn skips_gpu() -> bool {
    let skip = std::env::var_os("INSTGS_SKIP_GPU").is_some_and(|v| v == "1");
    if skip {
        eprintln!("INSTGS_SKIP_GPU=1: A TEST THAT NEEDS A VULKAN DEVICE IS SKIPPED");
    }
    skip
}
