//! Selection of the Vulkan device, and the validation layers.

use std::sync::Arc;

use clap::Args;

use crate::error::CliError;
use instgs_vk::gpu::{DeviceChoice, Faults, Gpu, GpuOptions};
use instgs_vk::kernels::open_tuned;

/// The environment variable that replaces `--device`.
const DEVICE_VARIABLE: &str = "INSTGS_DEVICE";
/// Set to 1, every command runs under the validation layers and fails on their first message; for tests.
const VALIDATION_VARIABLE: &str = "INSTGS_VALIDATION";

/// The flag that selects the Vulkan device.
#[derive(Args)]
pub struct DeviceArgs {
    /// Vulkan device: its number in `instgs-vk info`, or a part of its name. The environment variable INSTGS_DEVICE
    /// does the same; without either the fastest kind of device is taken
    #[arg(long, global = true, value_name = "N|NAME")]
    device: Option<String>,
}

impl DeviceArgs {
    /// The flag's value; `None` without the flag.
    pub fn as_given(&self) -> Option<&str> {
        self.device.as_deref()
    }

    /// The device of the flag, else of the variable, else the best device.
    pub fn choice(&self) -> DeviceChoice {
        let variable = || std::env::var(DEVICE_VARIABLE).ok().filter(|text| !text.is_empty());
        let text = self.device.clone().or_else(variable);
        text.map_or(DeviceChoice::Best, |text| {
            text.parse().unwrap_or_else(|never: std::convert::Infallible| match never {})
        })
    }
}

/// True if the environment enables the validation layers.
pub fn validation() -> bool {
    std::env::var_os(VALIDATION_VARIABLE).is_some_and(|value| value == "1")
}

/// Opens the device, with the validation layers if they are enabled.
pub fn open(choice: DeviceChoice) -> Result<Arc<Gpu>, CliError> {
    let faults = Faults::of_environment()?;
    Ok(open_tuned(GpuOptions { device: choice, validation: validation(), faults, ..Default::default() })?)
}

/// Fails if the validation layers reported a message; always succeeds without them.
pub fn check_validation(gpu: &Gpu) -> Result<(), CliError> {
    match gpu.validation_messages().take().first() {
        None => Ok(()),
        Some(message) => Err(CliError::msg(format!("validation layers: {message}"))),
    }
}
