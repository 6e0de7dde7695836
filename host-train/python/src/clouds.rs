//! Clouds of several pairs.

use crate::cloud::{Cloud, View};
use crate::error::{Error, bad};
use crate::mesh::Mesh;
use numpy::{PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// Clouds of several pairs.
pub(crate) enum Clouds<'py> {
    /// The same cloud for all pairs.
    One(Cloud<'py>),
    /// One cloud for each pair.
    Each(Vec<PyResult<Cloud<'py>>>),
}

impl<'py> Clouds<'py> {
    /// An array (N, 3) or a mesh is one cloud; anything else is a sequence of clouds.
    pub(crate) fn new(name: &str, given: &Bound<'py, PyAny>) -> PyResult<Clouds<'py>> {
        let array = given.cast::<PyUntypedArray>();
        if given.is_instance_of::<Mesh>() || array.is_ok_and(|array| array.ndim() == 2) {
            return Ok(Clouds::One(Cloud::or_mesh(name, given)?));
        }
        let items = given.try_iter().map_err(|_| {
            let found = given.get_type();
            bad(
                name,
                format!("expected a sequence of clouds, or one for all, found {found}"),
            )
        })?;
        let cloud = |(i, item): (usize, PyResult<Bound<'py, PyAny>>)| {
            // What says nothing of the cloud, such as an interrupt, ends the call.
            match Cloud::or_mesh(format!("{name}[{i}]"), &item?) {
                Err(error) if !error.is_instance_of::<Error>(given.py()) => Err(error),
                cloud => Ok(cloud),
            }
        };
        Ok(Clouds::Each(
            items.enumerate().map(cloud).collect::<PyResult<_>>()?,
        ))
    }

    /// The cloud of a pair.
    pub(crate) fn view(&self, py: Python<'_>, pair: usize) -> PyResult<View<'_>> {
        match self {
            Clouds::One(cloud) => Ok(cloud.view()),
            Clouds::Each(clouds) => match &clouds[pair] {
                Ok(cloud) => Ok(cloud.view()),
                Err(error) => Err(error.clone_ref(py)),
            },
        }
    }
}
