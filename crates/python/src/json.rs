//! Reports and events as Python objects: those that their JSON stands for.

use pyo3::prelude::*;
use serde::Serialize;

use crate::error::OrRaise;

/// The dictionaries, lists, numbers and texts of a value's JSON. What is no number in Rust is `None`.
pub(crate) fn to_python<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).or_raise()?;
    py.import("json")?.call_method1("loads", (text,))
}
