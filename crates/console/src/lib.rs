//! Shared parts of the command-line programs: the one [`Printer`], progress, text tables, and the flags for devices,
//! scenes, views and rendering options ([`args`], [`device`]).
//!
//! Exit codes: [`SUCCESS`], [`FAILURE`] (one line `error: what, where, what to do` on stderr), [`USAGE`].

pub mod args;
pub mod device;
pub mod error;
mod lavapipe;
pub mod opened;
pub mod printer;
pub mod table;

use std::process::ExitCode;

pub use error::{CliError, failed_to_render};
pub use lavapipe::choose_lavapipe_width;
pub use printer::{Printer, Progress};

/// Exit code of a command that succeeded.
pub const SUCCESS: u8 = 0;
/// Exit code of a command that failed.
pub const FAILURE: u8 = 1;
/// Exit code of a command with invalid arguments.
pub const USAGE: u8 = 2;

/// Parses the process's arguments as `A`. `Err` holds the exit code if the program should end, since help or an error was
/// printed.
pub fn parse<A: clap::Parser>() -> Result<A, ExitCode> {
    A::try_parse().map_err(|error| {
        // Help goes to stdout and counts as success. A closed stream is ignored.
        let _ = error.print();
        ExitCode::from(if error.use_stderr() { USAGE } else { SUCCESS })
    })
}

/// Prints the error of a finished command, if any, and returns its exit code.
pub fn exit_code(result: Result<(), CliError>, printer: &Printer) -> ExitCode {
    match result {
        Ok(()) => ExitCode::from(SUCCESS),
        Err(error) => {
            printer.error(&error);
            ExitCode::from(FAILURE)
        }
    }
}
