//! Vulkan devices.

use std::sync::Arc;

use instgs_console::device::{choice_of, open};
use instgs_vk::gpu::Gpu;
use pyo3::prelude::*;

use crate::error::OrRaise;
use crate::json::to_python;

/// A device by its number or a part of its name.
#[derive(FromPyObject)]
pub(crate) enum DeviceName {
    /// Its index in `devices()`.
    Number(usize),
    /// A part of its name.
    Name(String),
}

/// Opens the device, else that of the environment variable INSTGS_DEVICE, else the best one.
pub(crate) fn open_device(py: Python<'_>, name: Option<DeviceName>) -> PyResult<Arc<Gpu>> {
    let text = name.map(|name| match name {
        DeviceName::Number(number) => number.to_string(),
        DeviceName::Name(text) => text,
    });
    py.detach(|| open(choice_of(text))).or_raise()
}

/// Fails if the validation layers, which INSTGS_VALIDATION=1 turns on, reported a message.
pub(crate) fn check_validation(gpu: &Gpu) -> PyResult<()> {
    instgs_console::device::check_validation(gpu).or_raise()
}

/// The Vulkan devices of this machine, in the order of their numbers: name, driver and limits of each.
///
/// Raises Error if there is no Vulkan loader.
#[pyfunction]
pub(crate) fn devices(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    to_python(py, &py.detach(Gpu::list).or_raise()?)
}
