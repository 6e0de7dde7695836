//! Steps of a registration as Python reads them.

use crate::array::matrix;
use host_train::pose64::{Pose64, Position};
use host_train::register::trace::{self, Probabilities};
use numpy::ndarray::{arr1, arr2};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use reagent_core::Pose;

/// One step of the policy: along and about each axis one of eleven step sizes.
#[pyclass(module = "reagent", frozen)]
pub struct Step {
    taken: trace::Step,
    origins: [Position; 2],
}

impl Step {
    /// A step between clouds with these origins.
    pub(crate) fn new(taken: trace::Step, origins: [Position; 2]) -> Step {
        Step { taken, origins }
    }
}

#[pymethods]
impl Step {
    /// Number of the step, from 1.
    #[getter]
    fn number(&self) -> usize {
        self.taken.step
    }

    /// Signed translation along x, y, z: (3,), float64.
    #[getter]
    fn translation<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_owned_array(py, arr1(&self.taken.translation.map(f64::from)))
    }

    /// Signed angles about x, y, z: (3,), float64, radians.
    #[getter]
    fn rotation_rad<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_owned_array(py, arr1(&self.taken.rotation_rad.map(f64::from)))
    }

    /// Number of the translation taken along x, y, z, of the eleven; 5 is stop.
    #[getter]
    fn translation_id(&self) -> (u8, u8, u8) {
        self.taken.translation_id.into()
    }

    /// Number of the rotation taken about x, y, z, of the eleven; 5 is stop.
    #[getter]
    fn rotation_id(&self) -> (u8, u8, u8) {
        self.taken.rotation_id.into()
    }

    /// Probability of each translation under the policy: (3, 11), float32.
    #[getter]
    fn translation_probability<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f32>>> {
        probabilities(py, self.taken.translation_probability.as_ref())
    }

    /// Probability of each rotation under the policy: (3, 11), float32.
    #[getter]
    fn rotation_probability<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f32>>> {
        probabilities(py, self.taken.rotation_probability.as_ref())
    }

    /// The pose after the step: (4, 4), float64.
    #[getter]
    fn target_from_source<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let [source, target] = self.origins;
        let near = Pose::from_rows(self.taken.target_from_source);
        matrix(py, Pose64::of(near, source, target).to_rows())
    }

    fn __repr__(&self) -> String {
        let Step { taken, .. } = self;
        let (number, translation, rotation) = (taken.step, taken.translation_id, taken.rotation_id);
        format!("Step(number={number}, translation_id={translation:?}, rotation_id={rotation:?})")
    }
}

fn probabilities<'py>(
    py: Python<'py>,
    of: Option<&Probabilities>,
) -> Option<Bound<'py, PyArray2<f32>>> {
    of.map(|of| PyArray2::from_owned_array(py, arr2(of)))
}
