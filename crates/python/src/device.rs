//! Vulkan devices.

use std::sync::Arc;

use instgs_vk::gpu::{DeviceChoice, Gpu, GpuOptions};
use instgs_vk::kernels::open_tuned;
use pyo3::prelude::*;

use crate::error::{OrRaise, raised};
use crate::json::to_python;

/// The environment variable that names the device where the user's code names none, as for the programs.
const DEVICE_VARIABLE: &str = "INSTGS_DEVICE";
/// Set to 1, everything runs under the validation layers and fails on their first message; for tests, as for the programs.
const VALIDATION_VARIABLE: &str = "INSTGS_VALIDATION";

/// A device by its number or a part of its name.
#[derive(FromPyObject)]
pub(crate) enum DeviceName {
    /// Its index in `devices()`.
    Number(i64),
    /// A part of its name.
    Name(String),
}

/// Opens the device, else that of the environment variable INSTGS_DEVICE, else the best one.
pub(crate) fn open_device(py: Python<'_>, name: Option<DeviceName>) -> PyResult<Arc<Gpu>> {
    let variable = || std::env::var(DEVICE_VARIABLE).ok().filter(|text| !text.is_empty()).map(DeviceName::Name);
    let device = match name.or_else(variable) {
        None => DeviceChoice::Best,
        Some(DeviceName::Number(number)) => {
            let index = usize::try_from(number).map_err(|_| raised(format_args!("there is no device {number}")))?;
            DeviceChoice::Index(index)
        }
        Some(DeviceName::Name(text)) => text.parse().or_raise()?,
    };
    let validation = std::env::var_os(VALIDATION_VARIABLE).is_some_and(|value| value == "1");
    py.detach(|| open_tuned(GpuOptions { device, validation, ..GpuOptions::default() })).or_raise()
}

/// Fails if the validation layers reported a message; always succeeds without them.
pub(crate) fn check_validation(gpu: &Gpu) -> PyResult<()> {
    match gpu.validation_messages().take().first() {
        None => Ok(()),
        Some(message) => Err(raised(format_args!("validation layers: {message}"))),
    }
}

/// The Vulkan devices of this machine, in the order of their numbers: name, driver and limits of each.
///
/// Raises Error if there is no Vulkan loader.
#[pyfunction]
pub(crate) fn devices(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    to_python(py, &py.detach(Gpu::list).or_raise()?)
}
