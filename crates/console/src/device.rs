//! The device that a command runs on, and the validation layers.

use std::sync::Arc;

use clap::Args;

use crate::error::CliError;
use instgs_vk::gpu::{DeviceChoice, Gpu, GpuOptions};

/// Environment variable that replaces `--device`.
const DEVICE_VARIABLE: &str = "INSTGS_DEVICE";
/// Set to 1, every command runs with the validation layers and fails on their first message; for tests.
const VALIDATION_VARIABLE: &str = "INSTGS_VALIDATION";

/// The Vulkan device that a command runs on.
#[derive(Args)]
pub struct DeviceArgs {
    /// Vulkan device: its number in `instgs-vk info`, or a part of its name. The environment variable INSTGS_DEVICE has
    /// the same effect; without either the fastest kind of device is used
    #[arg(long, global = true, value_name = "N|NAME")]
    device: Option<String>,
}

impl DeviceArgs {
    /// The flag, else the environment variable, else the best device.
    pub fn choice(&self) -> DeviceChoice {
        let variable = || std::env::var(DEVICE_VARIABLE).ok().filter(|text| !text.is_empty());
        let text = self.device.clone().or_else(variable);
        text.map_or(DeviceChoice::Best, |text| {
            text.parse().unwrap_or_else(|never: std::convert::Infallible| match never {})
        })
    }
}

/// True if the user asks for the validation layers.
pub fn validation() -> bool {
    std::env::var_os(VALIDATION_VARIABLE).is_some_and(|value| value == "1")
}

/// Opens the device, with the validation layers if they are asked for.
pub fn open(choice: DeviceChoice) -> Result<Arc<Gpu>, CliError> {
    Ok(Gpu::open(&GpuOptions { device: choice, validation: validation(), ..Default::default() })?)
}

/// Fails if the validation layers reported anything; without them there is nothing to check.
pub fn check_validation(gpu: &Gpu) -> Result<(), CliError> {
    match gpu.validation_messages().take().first() {
        None => Ok(()),
        Some(message) => Err(CliError::msg(format!("validation layers: {message}"))),
    }
}
