//! Shared by the programs that run on a terminal: the one [`Printer`], progress, tables of text, and the flags for
//! devices, scenes, views and rendering options ([`args`], [`device`]).
//!
//! Exit codes: [`SUCCESS`], [`FAILURE`] (one line `error: what, where, what to do` on stderr), [`USAGE`].

pub mod args;
pub mod device;
pub mod error;
mod lavapipe;
pub mod printer;
pub mod table;

use std::process::ExitCode;

pub use error::{CliError, failed_to_render};
pub use lavapipe::choose_lavapipe_width;
pub use printer::{Printer, Progress};

/// The exit code of a command that succeeded.
pub const SUCCESS: u8 = 0;
/// The exit code of a command that failed.
pub const FAILURE: u8 = 1;
/// The exit code of a command with wrong arguments.
pub const USAGE: u8 = 2;

/// Parses the process's arguments as `A`. `Err` holds the exit code of a program that should end, because help or a
/// message about the arguments was printed.
pub fn parse<A: clap::Parser>() -> Result<A, ExitCode> {
    A::try_parse().map_err(|error| {
        // Help goes to stdout and is no failure. A closed stream is not an error either.
        let _ = error.print();
        ExitCode::from(if error.use_stderr() { USAGE } else { SUCCESS })
    })
}

/// The exit code of a finished command, after its error was printed.
pub fn exit_code(result: Result<(), CliError>, printer: &Printer) -> ExitCode {
    match result {
        Ok(()) => ExitCode::from(SUCCESS),
        Err(error) => {
            printer.error(&error);
            ExitCode::from(FAILURE)
        }
    }
}
