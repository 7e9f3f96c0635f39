//! What tests of disturbed programs share: the program, a small data set, a short training, and the one line of an error.

use std::path::Path;
use std::process::{Command, Output};

use crate::common::program::{built, repository};
use crate::made_once::car_park;

/// The program, undisturbed. A plain command: it is killed, or run by another program.
pub(crate) fn instgs_vk() -> Command {
    let mut command = Command::new(built("instgs-vk"));
    command.current_dir(repository());
    command
}

/// A data set of 12 small photos as `data`.
pub(crate) fn photos(at: &Path) {
    car_park(12, (96, 54), at);
}

/// A training of a small plain cloud from the photos in `at` into a folder there, or what is left of it; `settings` say how long.
pub(crate) fn training(mut command: Command, at: &Path, out: &str, settings: &[&str]) -> Command {
    command.args(["train", "--data"]).arg(at.join("data")).arg("--out").arg(at.join(out)).arg("--resume");
    command.args(["--config", "quick"]).args(settings);
    command
}

/// The one line that a command ends with.
pub(crate) fn error_line(output: &Output) -> String {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    let errors: Vec<&str> = text.lines().filter(|line| !line.starts_with("warning: ")).collect();
    assert!(output.status.code() == Some(1) && errors.len() == 1, "{:?}: {text}", output.status);
    assert!(errors[0].starts_with("error: "), "{text}");
    errors[0].to_owned()
}
