//! The keyword values of an edit, taken one by one; what is left at the end is an error.

use std::collections::BTreeMap;

use glam::DVec3;
use instgs_vk::scene::edit::Selector;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use crate::arrays::{Numbers, direction, matrix, vector};
use crate::error::{OrRaise, raised};

/// The values that have not been taken yet.
pub(crate) struct Values<'a, 'py> {
    which: Option<&'a Bound<'py, PyAny>>,
    named: BTreeMap<String, Bound<'py, PyAny>>,
}

impl<'a, 'py> Values<'a, 'py> {
    /// The arguments of a call.
    pub(crate) fn new(which: Option<&'a Bound<'py, PyAny>>, named: Option<&Bound<'py, PyDict>>) -> PyResult<Self> {
        let pairs = named.into_iter().flat_map(|named| named.iter());
        // None is as good as no value.
        let given = pairs.filter(|(_, value)| !value.is_none());
        let named = given.map(|(name, value)| Ok((name.extract()?, value))).collect::<PyResult<_>>()?;
        Ok(Self { which, named })
    }

    /// The instances that the edit is for.
    pub(crate) fn selector(&mut self) -> PyResult<Selector> {
        let which = self.which.take();
        selector(
            which.ok_or_else(|| {
                raised("want an instance: an index, a list, \"id:N\", \"group:NAME\" or \"template:N\"")
            })?,
        )
    }

    /// Takes a value, if it was given.
    pub(crate) fn any(&mut self, name: &str) -> Option<Bound<'py, PyAny>> {
        self.named.remove(name)
    }

    /// Takes a value of a plain type, if it was given.
    pub(crate) fn taken<T: FromPyObjectOwned<'py>>(&mut self, name: &str) -> PyResult<Option<T>> {
        let Some(value) = self.any(name) else { return Ok(None) };
        let wrong = |_| raised(format_args!("{name}={value} is not of the right kind"));
        value.extract().map(Some).map_err(wrong)
    }

    /// Takes a value of a plain type that must be there.
    pub(crate) fn needed<T: FromPyObjectOwned<'py>>(&mut self, name: &str) -> PyResult<T> {
        self.taken(name)?.ok_or_else(|| missing(name))
    }

    /// Takes an angle in degrees; returns radians.
    pub(crate) fn radians(&mut self, name: &str) -> PyResult<Option<f64>> {
        Ok(self.taken::<f64>(name)?.map(f64::to_radians))
    }

    /// Takes N numbers, if they were given.
    pub(crate) fn vector<const N: usize>(&mut self, name: &str) -> PyResult<Option<[f64; N]>> {
        self.any(name).map(|value| vector(&value, name)).transpose()
    }

    /// Takes a direction of any length but zero, if it was given.
    pub(crate) fn direction(&mut self, name: &str) -> PyResult<Option<DVec3>> {
        self.any(name).map(|value| direction(&value, name)).transpose()
    }

    /// Takes N numbers that must be there.
    pub(crate) fn needed_vector<const N: usize>(&mut self, name: &str) -> PyResult<[f64; N]> {
        self.vector(name)?.ok_or_else(|| missing(name))
    }

    /// Takes R rows of N numbers that must be there.
    pub(crate) fn needed_matrix<const R: usize, const N: usize>(&mut self, name: &str) -> PyResult<[[f64; N]; R]> {
        self.any(name).map(|value| matrix(&value, name)).transpose()?.ok_or_else(|| missing(name))
    }

    /// Takes a list of points, if it was given.
    pub(crate) fn points(&mut self, name: &str) -> PyResult<Option<Vec<DVec3>>> {
        let Some(value) = self.any(name) else { return Ok(None) };
        let points = Numbers::<f64>::of(&value, name, &[None, Some(3)])?.rows();
        Ok(Some(points.into_iter().map(DVec3::from_array).collect()))
    }

    /// Fails if a value was not taken.
    pub(crate) fn end(&self) -> PyResult<()> {
        match (self.which, self.named.first_key_value()) {
            (Some(which), _) => Err(raised(format_args!("is for a template or the scene, not for instance {which}"))),
            (None, Some((name, _))) => Err(raised(format_args!("has no {name}"))),
            (None, None) => Ok(()),
        }
    }
}

/// A selector from an index, a list of them, or a text as on the command line.
pub(crate) fn selector(which: &Bound<'_, PyAny>) -> PyResult<Selector> {
    if which.is_instance_of::<PyString>() {
        return which.extract::<String>()?.parse().or_raise();
    }
    if let Ok(index) = which.extract::<usize>() {
        return Ok(Selector::Index(index));
    }
    let wrong = |_| {
        raised(format_args!("{which} names no instance: want an index, a list of them, or a text like \"group:car\""))
    };
    which.extract::<Vec<usize>>().map(Selector::Indices).map_err(wrong)
}

fn missing(name: &str) -> PyErr {
    raised(format_args!("{name}=... is missing"))
}
