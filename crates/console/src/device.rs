//! Which device a command runs on, and whether the validation layers watch.

use std::sync::Arc;

use clap::Args;

use crate::error::CliError;
use instgs_vk::gpu::{DeviceChoice, Gpu, GpuOptions};

/// Stands in for `--device`.
const DEVICE_VARIABLE: &str = "INSTGS_DEVICE";
/// Set to 1, every command runs under the validation layers and fails on their first message; for tests.
const VALIDATION_VARIABLE: &str = "INSTGS_VALIDATION";

/// Which Vulkan device a command runs on.
#[derive(Args)]
pub struct DeviceArgs {
    /// Vulkan device: its number in `instgs-vk info`, or a part of its name. The environment variable INSTGS_DEVICE
    /// does the same; without either the fastest kind of device is taken
    #[arg(long, global = true, value_name = "N|NAME")]
    device: Option<String>,
}

impl DeviceArgs {
    /// The flag, else the variable, else the best device.
    pub fn choice(&self) -> DeviceChoice {
        let variable = || std::env::var(DEVICE_VARIABLE).ok().filter(|text| !text.is_empty());
        let text = self.device.clone().or_else(variable);
        text.map_or(DeviceChoice::Best, |text| {
            text.parse().unwrap_or_else(|never: std::convert::Infallible| match never {})
        })
    }
}

/// True if the user wants the validation layers to watch.
pub fn validation() -> bool {
    std::env::var_os(VALIDATION_VARIABLE).is_some_and(|value| value == "1")
}

/// Opens the device.
pub fn open(choice: DeviceChoice) -> Result<Arc<Gpu>, CliError> {
    Ok(Gpu::open(&GpuOptions { device: choice, validation: validation(), ..Default::default() })?)
}

/// Fails if the validation layers had anything to say; without them there is nothing to check.
pub fn check_validation(gpu: &Gpu) -> Result<(), CliError> {
    match gpu.validation_messages().take().first() {
        None => Ok(()),
        Some(message) => Err(CliError::msg(format!("validation layers: {message}"))),
    }
}
