//! The error type of commands.

use std::fmt::Display;

use instgs_vk::render::RenderError;

/// Why a command failed, one line. Libraries have typed errors to match on; a command only prints them.
pub type CliError = anyhow::Error;

/// Adds the scene or view that a rendering error belongs to.
pub fn failed_to_render(place: impl Display) -> impl FnOnce(RenderError) -> CliError {
    move |error| CliError::msg(format!("{place}: {error}"))
}
