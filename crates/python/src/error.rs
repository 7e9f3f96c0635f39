//! The one exception class, and warnings.

use std::ffi::CString;
use std::fmt::Display;

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyUserWarning};
use pyo3::prelude::*;

create_exception!(
    instgs,
    Error,
    PyException,
    "What was asked for is not possible. The text is one line: what is wrong, where, and what to do."
);

/// Turns errors of the libraries into the exception.
pub(crate) trait OrRaise<T> {
    /// The value, or an `instgs.Error` with the error's text.
    fn or_raise(self) -> PyResult<T>;
}

impl<T, E: Display> OrRaise<T> for Result<T, E> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(raised)
    }
}

/// An `instgs.Error` with this text.
pub(crate) fn raised(what: impl Display) -> PyErr {
    Error::new_err(what.to_string())
}

/// Why work that calls back into Python ended early.
pub(crate) enum Stopped<E> {
    /// An exception of the user's callback, or Ctrl-C.
    Python(PyErr),
    /// What the work itself found wrong.
    Failed(E),
}

impl<E> From<E> for Stopped<E> {
    fn from(error: E) -> Self {
        Self::Failed(error)
    }
}

impl<E: Display> From<Stopped<E>> for PyErr {
    fn from(stopped: Stopped<E>) -> Self {
        match stopped {
            Stopped::Python(error) => error,
            Stopped::Failed(error) => raised(error),
        }
    }
}

/// Lets Ctrl-C, or another signal that Python has a handler for, stop work that leaves the interpreter free.
///
/// # Errors
/// The exception that the handler raised.
pub(crate) fn look_for_ctrl_c<E>() -> Result<(), Stopped<E>> {
    Python::attach(|py| py.check_signals()).map_err(Stopped::Python)
}

/// Issues a `UserWarning` at the line that called into this module.
///
/// # Errors
/// The user turned warnings into exceptions.
pub(crate) fn warn(py: Python<'_>, what: impl Display) -> PyResult<()> {
    // A null character would end a C string.
    let text = CString::new(what.to_string().replace('\0', " ")).or_raise()?;
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
}
