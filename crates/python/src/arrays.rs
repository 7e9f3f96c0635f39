//! Arrays to and from numpy. All that go out are copies; what comes in may be anything that numpy makes an array of.

use glam::DVec3;
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{OrRaise, raised};

/// The largest id of an object: that of a mask with 16 bits.
const MAX_ID: u16 = u16::MAX;

/// A numpy array `[len, N]` of rows.
pub(crate) fn from_rows<'py, T: Element + Copy, const N: usize>(
    py: Python<'py>,
    rows: &[[T; N]],
) -> PyResult<Bound<'py, PyArray2<T>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])
}

/// A numpy array `[len / each, each, N]` of `each` rows for every element.
pub(crate) fn from_row_groups<'py, const N: usize>(
    py: Python<'py>,
    rows: &[[f32; N]],
    each: usize,
) -> PyResult<Bound<'py, PyArray3<f32>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len() / each.max(1), each, N])
}

/// An array that came in: its numbers row by row, and its shape.
pub(crate) struct Numbers<T> {
    /// The numbers, the last axis fastest.
    pub(crate) values: Vec<T>,
    /// The length of each axis.
    pub(crate) shape: Vec<usize>,
}

impl<T: Element + Copy> Numbers<T> {
    /// Reads an array-like value, converted to `T`. `want` has one entry per axis, `None` for any length.
    ///
    /// # Errors
    /// numpy makes no array of it, or one of another shape; the text names the value by `name`.
    pub(crate) fn of(value: &Bound<'_, PyAny>, name: &str, want: &[Option<usize>]) -> PyResult<Self> {
        let py = value.py();
        let options = PyDict::new(py);
        options.set_item("dtype", numpy::dtype::<T>(py))?;
        let array = py.import("numpy")?.call_method("ascontiguousarray", (value,), Some(&options));
        let array = array.map_err(|e| raised(format_args!("{name}: {}", e.value(py))))?;
        let array: PyReadonlyArrayDyn<'_, T> = array.cast::<PyArrayDyn<T>>().map_err(PyErr::from)?.readonly();
        let shape = array.as_array().shape().to_vec();
        let fits =
            shape.len() == want.len() && shape.iter().zip(want).all(|(have, want)| want.is_none_or(|w| w == *have));
        if !fits {
            return Err(raised(format_args!("{name} has shape {}, want {}", shape_text(&shape), wanted_text(want))));
        }
        Ok(Self { values: array.as_slice().or_raise()?.to_vec(), shape })
    }

    /// The numbers as rows of N; what does not fill a row is dropped, which a checked shape rules out.
    pub(crate) fn rows<const N: usize>(&self) -> Vec<[T; N]> {
        self.values.as_chunks().0.to_vec()
    }
}

/// The ids of objects in an array-like value of any kind of number, 0 for none. They are not read as integers: numpy would wrap and
/// cut what is no id.
///
/// # Errors
/// The same as [`Numbers::of`]; or a number that is no id, which the text names.
pub(crate) fn ids(value: &Bound<'_, PyAny>, name: &str, want: &[Option<usize>]) -> PyResult<Vec<u32>> {
    let is_id = |v: f64| (0.0..=f64::from(MAX_ID)).contains(&v) && v.fract() == 0.0;
    let id = |v: f64| match is_id(v) {
        true => Ok(v as u32),
        false => Err(raised(format_args!("{name}: {v} is no id of an object: want whole numbers from 0 to {MAX_ID}"))),
    };
    Numbers::<f64>::of(value, name, want)?.values.into_iter().map(id).collect()
}

/// A direction of any length but zero.
///
/// # Errors
/// The same as [`vector`]; or numbers that have no direction.
pub(crate) fn direction(value: &Bound<'_, PyAny>, name: &str) -> PyResult<DVec3> {
    let direction = DVec3::from_array(vector(value, name)?);
    if direction.try_normalize().is_none() {
        return Err(raised(format_args!("{name} has no direction: want finite numbers that are not all 0")));
    }
    Ok(direction)
}

/// N numbers of an array-like value.
///
/// # Errors
/// The same as [`Numbers::of`].
pub(crate) fn vector<const N: usize>(value: &Bound<'_, PyAny>, name: &str) -> PyResult<[f64; N]> {
    let rows = Numbers::of(value, name, &[Some(N)])?.rows();
    rows.first().copied().ok_or_else(|| raised(format_args!("{name} is empty")))
}

/// The rows of an array-like matrix, R x N.
///
/// # Errors
/// The same as [`Numbers::of`].
pub(crate) fn matrix<T: Element + Copy, const R: usize, const N: usize>(
    value: &Bound<'_, PyAny>,
    name: &str,
) -> PyResult<[[T; N]; R]> {
    let rows = Numbers::of(value, name, &[Some(R), Some(N)])?.rows();
    rows.try_into().map_err(|_| raised(format_args!("{name} is no {R}x{N} matrix")))
}

fn shape_text(shape: &[usize]) -> String {
    wanted_text(&shape.iter().copied().map(Some).collect::<Vec<_>>())
}

fn wanted_text(shape: &[Option<usize>]) -> String {
    let axes: Vec<String> = shape.iter().map(|n| n.map_or_else(|| "N".to_owned(), |n| n.to_string())).collect();
    format!("[{}]", axes.join(", "))
}
