//! The subcommands of the program `instgs-evidence`, which is installed in the same folder: data sets with known truth,
//! and comparisons of instanced and plain scenes. They are a program of their own because users need neither a ray
//! tracer nor tables of evidence.

use std::env::consts::EXE_SUFFIX;
use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, ExitCode};

use instgs_console::CliError;

/// The paragraph of `--help` about them.
pub(crate) const HELP: &str = "\
Commands that run the program instgs-evidence (each has --help):
  demo      All steps on generated photos of eight cars: trains, compares, draws
  synth     Makes a ray-traced data set with known poses, masks and depths
  compare   Trains an instanced scene and 3DGS of the same time and bytes, and compares them
  tables    The comparison for a list of scenes, with rivals, ablations and plots";

/// Names of the subcommands.
const COMMANDS: [&str; 4] = ["demo", "synth", "compare", "tables"];

/// Runs the program `instgs-evidence` with the same arguments if the subcommand belongs to it; `None` if it does not.
pub(crate) fn run_if_asked(args: impl Iterator<Item = OsString>) -> Option<Result<ExitCode, CliError>> {
    let args: Vec<OsString> = args.collect();
    let name = subcommand(&args)?;
    COMMANDS.contains(&name).then(|| run(&args, name))
}

/// The first argument that is no flag, not the value of `--device` (which may come before a subcommand), and not `help`.
fn subcommand(args: &[OsString]) -> Option<&str> {
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        match arg.to_str()? {
            "--device" => args.next(),
            flag if flag.starts_with('-') || flag == "help" => None,
            name => return Some(name),
        };
    }
    None
}

fn run(args: &[OsString], name: &str) -> Result<ExitCode, CliError> {
    let program = std::env::current_exe()?.with_file_name(format!("instgs-evidence{EXE_SUFFIX}"));
    if !program.is_file() {
        let place = program.display();
        return Err(CliError::msg(format!(
            "{name} is a command of instgs-evidence, which does not exist ({place}): cargo build --release makes it"
        )));
    }
    let mut command = Command::new(&program);
    command.args(args);
    // Replaces this process, so that signals reach the program.
    #[cfg(unix)]
    return Err(not_started(&program, &std::os::unix::process::CommandExt::exec(&mut command)));
    #[cfg(not(unix))]
    {
        let status = command.status().map_err(|error| not_started(&program, &error))?;
        let code = status.code().and_then(|code| u8::try_from(code).ok());
        Ok(ExitCode::from(code.unwrap_or(instgs_console::FAILURE)))
    }
}

fn not_started(program: &Path, error: &std::io::Error) -> CliError {
    CliError::msg(format!("{}: cannot be started: {error}", program.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_subcommand_is_found_behind_flags() {
        let of = |words: &str| {
            let args: Vec<OsString> = words.split_whitespace().map(OsString::from).collect();
            subcommand(&args).map(str::to_string)
        };
        assert_eq!(of("demo --out x").as_deref(), Some("demo"));
        assert_eq!(of("--device llvm synth cars").as_deref(), Some("synth"));
        assert_eq!(of("--device=0 tables a").as_deref(), Some("tables"));
        assert_eq!(of("help demo").as_deref(), Some("demo"));
        assert_eq!(of("train --out demo").as_deref(), Some("train"));
        assert_eq!((of("--version"), of("")), (None, None));
    }
}
