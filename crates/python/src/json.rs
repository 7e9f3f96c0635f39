//! Reports and events as Python objects: those that their JSON stands for.

use pyo3::prelude::*;
use serde::Serialize;

use crate::error::OrRaise;

/// The dictionaries, lists, numbers and texts of a value's JSON. What is no number in Rust is `None`.
pub(crate) fn to_python<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    text_to_python(py, &serde_json::to_string(value).or_raise()?)
}

/// The same of a JSON text.
pub(crate) fn text_to_python<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("json")?.call_method1("loads", (text,))
}
