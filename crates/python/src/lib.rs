//! x
use pyo3::prelude::*;
#[pymodule]
fn instgs(_m: &Bound<'_, PyModule>) -> PyResult<()> { Ok(()) }
