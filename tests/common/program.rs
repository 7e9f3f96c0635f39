//! The program as tests run it.

use std::env::consts::EXE_SUFFIX;
use std::path::{Path, PathBuf};

use assert_cmd::Command;

/// The path of a program of this workspace, which `cargo test` builds beside the tests: tests of other packages need it, too.
pub(crate) fn built(name: &str) -> PathBuf {
    let tests = std::env::current_exe().unwrap();
    let path = tests.ancestors().nth(2).unwrap().join(format!("{name}{EXE_SUFFIX}"));
    assert!(path.is_file(), "{} is not there: cargo build --bin {name}", path.display());
    path
}

/// The folder of the repository: tests of several packages share this code.
pub(crate) fn repository() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.ancestors().find(|folder| folder.join("glsl").is_dir()).unwrap()
}

/// The program `instgs-vk`, in the repository's folder, where it finds the library that `tools/setup_onnxruntime` fetched.
pub(crate) fn program() -> Command {
    let mut command = Command::new(built("instgs-vk"));
    command.current_dir(repository());
    command
}

/// Runs, wants exit code 1 and exactly one line on stderr, which it returns.
pub(crate) fn error_of(command: &mut Command) -> String {
    let output = command.assert().code(1).get_output().clone();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.starts_with("error: ") && text.ends_with('\n') && text.lines().count() == 1, "{text:?}");
    text
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
