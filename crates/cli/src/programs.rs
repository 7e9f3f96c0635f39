//! The other programs of the project, which this one starts: `instgs-evidence` and `instgs-player`.

use std::env::consts::EXE_SUFFIX;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

use instgs_console::CliError;

/// The program `name` in the folder of this one; `None` if it is not there.
pub(crate) fn beside(name: &str) -> std::io::Result<Option<PathBuf>> {
    let path = std::env::current_exe()?.with_file_name(format!("{name}{EXE_SUFFIX}"));
    Ok(path.is_file().then_some(path))
}

/// The program `name` in the first folder of PATH that has it.
pub(crate) fn on_path(name: &str) -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    std::env::split_paths(&folders).map(|folder| folder.join(format!("{name}{EXE_SUFFIX}"))).find(|path| path.is_file())
}

/// Runs a program in place of this one, so that signals reach it. Returns its exit code where that is not possible.
pub(crate) fn become_program(program: &Path, args: &[OsString]) -> Result<ExitCode, CliError> {
    let not_started =
        |error: &std::io::Error| CliError::msg(format!("{}: cannot be started: {error}", program.display()));
    let mut command = Command::new(program);
    command.args(args);
    #[cfg(unix)]
    return Err(not_started(&std::os::unix::process::CommandExt::exec(&mut command)));
    #[cfg(not(unix))]
    {
        let status = command.status().map_err(|error| not_started(&error))?;
        let code = status.code().and_then(|code| u8::try_from(code).ok());
        Ok(ExitCode::from(code.unwrap_or(instgs_console::FAILURE)))
    }
}
