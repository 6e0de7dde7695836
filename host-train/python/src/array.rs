//! Python arrays as points and poses.

use crate::error::{CloudError, bad};
use host_train::dataset::Point;
use host_train::pose64::{Pose64, Position};
use numpy::ndarray::{ArrayView2, arr2};
use numpy::{
    PyArray2, PyArrayDescrMethods, PyArrayMethods, PyReadonlyArray2, PyReadonlyArrayDyn,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyException, PyMemoryError};
use pyo3::prelude::*;
use pyo3::{PyTypeInfo, intern};

/// An array (N, 3) whose numbers stay where Python has them.
pub(crate) enum Numbers<'py> {
    F32(PyReadonlyArray2<'py, f32>),
    F64(PyReadonlyArray2<'py, f64>),
}

/// The same, usable while Python goes on.
#[derive(Clone, Copy)]
pub(crate) enum Rows<'a> {
    /// Points in Rust's layout.
    Points(&'a [Point]),
    F32(ArrayView2<'a, f32>),
    F64(ArrayView2<'a, f64>),
}

impl Rows<'_> {
    /// A copy of all points in f64.
    pub(crate) fn positions(self) -> Vec<Position> {
        fn of<T: Copy + Into<f64>>(rows: ArrayView2<'_, T>) -> Vec<Position> {
            rows.outer_iter()
                .map(|row| [0, 1, 2].map(|axis| row[axis].into()))
                .collect()
        }
        match self {
            Rows::Points(rows) => rows.iter().map(|p| p.map(f64::from)).collect(),
            Rows::F32(rows) => of(rows),
            Rows::F64(rows) => of(rows),
        }
    }
}

impl<'py> Numbers<'py> {
    /// Takes an array (N, 3) of f32 or f64 in any memory order, or what `numpy.asarray` makes one of. Nothing is copied
    /// unless NumPy has to. Masked points become NaN and are left out later.
    pub(crate) fn of(name: &str, given: &Bound<'py, PyAny>) -> PyResult<Numbers<'py>> {
        let array = as_array(name, given)?;
        let wrong = |what: String| {
            CloudError::new_err(format!(
                "{name}: expected an array of float32 or float64 of shape (N, 3), found {what}"
            ))
        };
        match *array.shape() {
            [_, 3] => {}
            [3, n] => {
                return Err(wrong(format!("shape (3, {n}); transpose it")));
            }
            _ => {
                let shape = array.getattr(intern!(given.py(), "shape"))?;
                return Err(wrong(format!("shape {shape} of {}", array.dtype())));
            }
        }
        let dtype = array.dtype();
        let (kind, size) = (dtype.kind(), dtype.itemsize());
        if kind != b'f' || ![4, 8].contains(&size) {
            return Err(wrong(format!("{dtype}; convert it with .astype(float)")));
        }
        let array = if is_plain(&array)? {
            array.into_any()
        } else {
            // Another byte order, or unaligned numbers.
            let plain = if size == 4 { "float32" } else { "float64" };
            array.call_method1(intern!(given.py(), "astype"), (plain,))?
        };
        Ok(match size {
            4 => Numbers::F32(array.cast_into::<PyArray2<f32>>()?.try_readonly()?),
            _ => Numbers::F64(array.cast_into::<PyArray2<f64>>()?.try_readonly()?),
        })
    }

    pub(crate) fn rows(&self) -> Rows<'_> {
        match self {
            Numbers::F32(array) => match array.as_array().to_slice() {
                Some(slice) => Rows::Points(slice.as_chunks().0),
                None => Rows::F32(array.as_array()),
            },
            Numbers::F64(array) => Rows::F64(array.as_array()),
        }
    }
}

/// Whether the processor can read the numbers where they lie.
fn is_plain(array: &Bound<'_, PyUntypedArray>) -> PyResult<bool> {
    let py = array.py();
    let flags = array.getattr(intern!(py, "flags"))?;
    let aligned: bool = flags.getattr(intern!(py, "aligned"))?.extract()?;
    Ok(aligned && array.dtype().is_native_byteorder() == Some(true))
}

/// The array that NumPy makes of the argument.
fn as_array<'py>(name: &str, given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyUntypedArray>> {
    let py = given.py();
    if given.is_exact_instance(&PyUntypedArray::type_object(py)) {
        return Ok(given.cast::<PyUntypedArray>()?.clone());
    }
    let numpy = py.import(intern!(py, "numpy"))?;
    let made =
        without_mask(given).and_then(|given| numpy.call_method1(intern!(py, "asarray"), (given,)));
    let array = made.map_err(|cause| {
        if is_of_the_interpreter(py, &cause) {
            return cause;
        }
        let error = CloudError::new_err(format!(
            "{name}: expected an array of float32 or float64 of shape (N, 3); numpy.asarray says: {}",
            cause.value(py)
        ));
        error.set_cause(py, Some(cause));
        error
    })?;
    Ok(array.cast_into::<PyUntypedArray>()?)
}

/// Whether an exception says nothing of the argument: an interrupt, an exit, no memory.
pub(crate) fn is_of_the_interpreter(py: Python<'_>, cause: &PyErr) -> bool {
    cause.is_instance_of::<PyMemoryError>(py) || !cause.is_instance_of::<PyException>(py)
}

/// The same object, or for a masked array one with NaN where it is masked.
pub(crate) fn without_mask<'py>(given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = given.py();
    let masked = py.import(intern!(py, "numpy.ma"))?;
    let is_masked = masked.call_method1(intern!(py, "isMaskedArray"), (given,))?;
    if !is_masked.is_truthy()? {
        return Ok(given.clone());
    }
    let wide = given.call_method1(intern!(py, "astype"), ("float64",))?;
    wide.call_method1(intern!(py, "filled"), (f64::NAN,))
}

/// Numbers of any shape in f64; masked ones are refused.
pub(crate) fn numbers<'py>(
    name: &str,
    given: &Bound<'py, PyAny>,
    expected: &str,
) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let py = given.py();
    let numpy = py.import(intern!(py, "numpy"))?;
    let unreadable = |cause: PyErr| {
        if is_of_the_interpreter(py, &cause) {
            return cause;
        }
        let said = cause.value(py).to_string();
        let error = bad(
            name,
            format!("expected {expected}; numpy.asarray says: {said}"),
        );
        error.set_cause(py, Some(cause));
        error
    };
    let array = numpy
        .call_method1(intern!(py, "asarray"), (given,))
        .map_err(unreadable)?;
    let dtype = array.cast::<PyUntypedArray>()?.dtype();
    if dtype.kind() == b'c' {
        return Err(bad(name, format!("expected {expected}, found {dtype}")));
    }
    let masked = py.import(intern!(py, "numpy.ma"))?;
    // Also within a list.
    let marked = masked.call_method1(intern!(py, "asarray"), (given,))?;
    let is_masked = masked.call_method1(intern!(py, "is_masked"), (marked,))?;
    if is_masked.is_truthy()? {
        let what = format!("expected {expected}, found masked elements; fill them first");
        return Err(bad(name, what));
    }
    let wide = numpy.call_method1(intern!(py, "asarray"), (array, "float64"));
    wide.map_err(unreadable)?.extract()
}

/// One pose, 4x4 or its first three rows `[R | t]`, or one for each of several pairs.
pub(crate) enum Poses {
    One(Pose64),
    Each(Vec<Pose64>),
}

pub(crate) fn poses(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Poses> {
    let expected = "a pose, 4x4 or the rows of [R | t]";
    let array = numbers(name, given, expected)?;
    let shape = array.shape().to_vec();
    let (rows, several) = match *shape.as_slice() {
        [rows, 4] => (rows, false),
        [_, rows, 4] => (rows, true),
        _ => (0, false),
    };
    if ![3, 4].contains(&rows) {
        return Err(bad(
            name,
            format!("expected {expected}, found shape {shape:?}"),
        ));
    }
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    let poses = values.as_chunks::<4>().0.chunks(rows).enumerate();
    let poses = poses.map(|(i, rows)| {
        let name = &*match several {
            true => format!("{name}[{i}]"),
            false => name.into(),
        };
        if rows
            .get(3)
            .is_some_and(|last| *last != [0.0, 0.0, 0.0, 1.0])
        {
            return Err(bad(name, "the last row of a pose is 0 0 0 1"));
        }
        let [a, b, c, ..] = *rows else {
            unreachable!("three rows or four");
        };
        let pose = Pose64::from_rows([a, b, c]).checked();
        pose.map_err(|error| bad(name, error))
    });
    let poses = poses.collect::<PyResult<Vec<Pose64>>>()?;
    Ok(match *poses.as_slice() {
        [pose] if !several => Poses::One(pose),
        _ => Poses::Each(poses),
    })
}

/// One point, or one for each of several pairs.
pub(crate) enum Positions {
    One(Position),
    Each(Vec<Position>),
}

pub(crate) fn positions(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Positions> {
    let expected = "three numbers";
    let array = numbers(name, given, expected)?;
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    if let Some(at) = values.iter().position(|x| !x.is_finite()) {
        let what = format!("expected three finite numbers, found {}", values[at]);
        return Err(match array.shape() {
            [_, 3] => bad(&format!("{name}[{}]", at / 3), what),
            _ => bad(name, what),
        });
    }
    match (array.shape(), values.as_slice()) {
        ([3], &[x, y, z]) => Ok(Positions::One([x, y, z])),
        ([_, 3], _) => Ok(Positions::Each(values.as_chunks::<3>().0.to_vec())),
        (shape, _) => Err(bad(
            name,
            format!("expected {expected}, found shape {shape:?}"),
        )),
    }
}

/// A pose as a 4x4 array.
pub(crate) fn matrix<'py>(py: Python<'py>, [a, b, c]: [[f64; 4]; 3]) -> Bound<'py, PyArray2<f64>> {
    PyArray2::from_owned_array(py, arr2(&[a, b, c, [0.0, 0.0, 0.0, 1.0]]))
}
