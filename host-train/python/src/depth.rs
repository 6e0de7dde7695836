//! Depth images as points.

use crate::arguments;
use crate::array::{is_of_the_interpreter, numbers, without_mask};
use crate::error::{Error, bad};
use host_train::dataset::depth::image::{Image, largest_integer};
use host_train::dataset::depth::{DepthImage, Depths, Intrinsics, checked_scale};
use numpy::ndarray::arr2;
use numpy::{PyArray2, PyArrayDescrMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::path::Path;

/// The points that a depth camera saw, in its own frame (x right, y down, z ahead): (N, 3), float64. It stood at the origin.
///
/// depth: (rows, columns) of float or of integers of 16 bits or more, along the camera's axis; 0, negative numbers, NaN and
///     the largest integer of the array's type, such as 65535, are no depth, nor are masked elements.
/// camera: fx, fy, cx, cy in pixels of an image without distortion, or the 3x3 matrix K.
/// mask: (rows, columns), which pixels show the object: those above 0; all if not given.
/// depth_scale: what a unit of depth is in the unit of the points, which should be the target's; for BOP's depth_scale that is
///     millimetres.
///
/// Raises Error where shapes differ, the camera is none, or nothing was measured where the object is.
///
/// >>> import numpy, reagent
/// >>> depth = numpy.array([[0, 500], [500, 1000]], numpy.uint16)
/// >>> points = reagent.points_of_depth(depth, (2, 2, 0.5, 0.5), depth_scale=0.001)
/// >>> points.round(3)
/// array([[ 0.125, -0.125,  0.5  ],
///        [-0.125,  0.125,  0.5  ],
///        [ 0.25 ,  0.25 ,  1.   ]])
/// >>> reagent.points_of_depth(depth, (2, 2, 0.5, 0.5), mask=depth > 2000)
/// Traceback (most recent call last):
/// reagent.Error: mask: no pixel shows the object: none is above 0
///
/// Such points are a view, which `register` takes with `viewpoint=(0, 0, 0)`; `register_depth` looks at the background, too.
#[pyfunction]
#[pyo3(signature = (depth, camera, mask = None, *, depth_scale = 1.0))]
pub(crate) fn points_of_depth<'py>(
    py: Python<'py>,
    depth: &Bound<'py, PyAny>,
    camera: &Bound<'py, PyAny>,
    mask: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = arguments::depth_scale)] depth_scale: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let seen = depth_image(depth, camera, mask, depth_scale)?;
    let points: Vec<[f64; 3]> = seen.object().iter().map(|p| p.map(f64::from)).collect();
    Ok(PyArray2::from_owned_array(py, arr2(&points)))
}

/// What was given as a depth image.
pub(crate) fn depth_image(
    depth: &Bound<'_, PyAny>,
    camera: &Bound<'_, PyAny>,
    mask: Option<&Bound<'_, PyAny>>,
    depth_scale: f64,
) -> PyResult<DepthImage> {
    checked_scale(depth_scale).map_err(Error::new_err)?;
    // What is no array yet, such as a tensor or a data frame, has its type once it is one.
    let numpy = depth.py().import("numpy")?;
    let depth = &match numpy.call_method1("asanyarray", (depth,)) {
        Err(cause) if is_of_the_interpreter(depth.py(), &cause) => return Err(cause),
        made => made.unwrap_or_else(|_| depth.clone()),
    };
    let dtype = depth.cast::<PyUntypedArray>().ok().map(|array| {
        let dtype = array.dtype();
        (dtype.kind(), dtype.itemsize())
    });
    if dtype.is_some_and(|(_, bytes)| bytes == 1) {
        let what = "expected floats or integers of 16 bits or more, found 8 bits";
        return Err(bad("depth", what));
    }
    let largest = dtype.and_then(|(kind, bytes)| largest_integer(kind, bytes));
    let depth = Depths::of(image("depth", &without_mask(depth)?, |x| x)?, largest).image;
    let mask = mask
        .map(|mask| image("mask", mask, |x| x > 0.0))
        .transpose()?;
    let camera = intrinsics(camera)?;
    let mask = mask.map(|mask| (Path::new("mask"), mask));
    let named = (Path::new("depth"), depth);
    DepthImage::checked(named, (Path::new("camera"), camera), mask, depth_scale)
        .map_err(|error| Error::new_err(error.to_string()))
}

fn image<T>(name: &str, given: &Bound<'_, PyAny>, of: fn(f64) -> T) -> PyResult<Image<T>> {
    let expected = "an array of shape (rows, columns)";
    let array = numbers(name, given, expected)?;
    let &[rows, columns] = array.shape() else {
        let shape = array.shape();
        return Err(bad(
            name,
            format!("expected {expected}, found shape {shape:?}"),
        ));
    };
    Ok(Image {
        size: [columns, rows],
        values: array.as_array().iter().copied().map(of).collect(),
    })
}

fn intrinsics(given: &Bound<'_, PyAny>) -> PyResult<Intrinsics> {
    let expected = "fx, fy, cx, cy or a matrix of shape (3, 3)";
    let array = numbers("camera", given, expected)?;
    let values: Vec<f64> = array.as_array().iter().copied().collect();
    let camera = match (array.shape(), values.as_slice()) {
        ([4], &[fx, fy, cx, cy]) => Intrinsics::new([fx, fy, cx, cy]),
        ([3, 3], &[a, b, c, d, e, f, g, h, i]) => {
            Intrinsics::of_matrix([a, b, c, d, e, f, g, h, i])
        }
        (shape, _) => Err(format!("expected {expected}, found shape {shape:?}")),
    };
    camera.map_err(|error| bad("camera", error))
}
