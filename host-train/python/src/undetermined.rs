//! What a shape leaves open, as Python reads it.

use host_train::register::document::{Open, OpenAxis, OpenFold, OpenSlide};
use numpy::ndarray::{Array3, arr1};
use numpy::{PyArray1, PyArray3};
use pyo3::prelude::*;

/// What the shape leaves open. True where there is anything.
#[pyclass(module = "reagent", frozen)]
pub struct Undetermined(pub(crate) Open);

#[pymethods]
impl Undetermined {
    /// The axis about which the turn is open, or None.
    #[getter]
    fn axis(&self) -> Option<Axis> {
        self.0.axis.clone().map(Axis)
    }

    /// Whether the axis may have any direction: a ball.
    #[getter]
    fn any_rotation(&self) -> bool {
        self.0.any_rotation
    }

    /// The direction along which the place is open, or None.
    #[getter]
    fn slide(&self) -> Option<Slide> {
        self.0.slide.clone().map(Slide)
    }

    /// The rotational symmetry by whose turns the clouds fit as well, or None.
    #[getter]
    fn fold(&self) -> Option<Fold> {
        self.0.fold.clone().map(Fold)
    }

    /// Other poses that fit as well, with all that the symmetry makes of them: (K, 4, 4), float64.
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        let rows = self
            .0
            .poses
            .iter()
            .flat_map(|&[a, b, c]| [a, b, c, [0.0, 0.0, 0.0, 1.0]]);
        let values: Vec<f64> = rows.flatten().collect();
        let shape = (self.0.poses.len(), 4, 4);
        let array = Array3::from_shape_vec(shape, values).expect("sixteen numbers a pose");
        PyArray3::from_owned_array(py, array)
    }

    fn __bool__(&self) -> bool {
        self.0.axis.is_some() || self.0.slide.is_some() || !self.0.poses.is_empty()
    }

    fn __repr__(&self) -> String {
        if self.0.any_rotation {
            return "Undetermined(any_rotation=True)".into();
        }
        let axis = self.axis().map_or("None".into(), |axis| axis.__repr__());
        let slide = self.slide().map_or("None".into(), |slide| slide.__repr__());
        let fold = self.fold().map_or("None".into(), |fold| fold.__repr__());
        format!(
            "Undetermined(axis={axis}, slide={slide}, fold={fold}, poses={})",
            self.0.poses.len()
        )
    }
}

/// A rotational symmetry: turned about this axis of the target by any multiple of a full turn over `order`, the clouds fit as well.
#[pyclass(module = "reagent", frozen)]
pub struct Fold(OpenFold);

#[pymethods]
impl Fold {
    /// A point of the axis, in the target's coordinates: (3,), float64.
    #[getter]
    fn point<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_owned_array(py, arr1(&self.0.point))
    }

    /// Its unit vector: (3,), float64.
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_owned_array(py, arr1(&self.0.direction.map(f64::from)))
    }

    /// How many poses it makes of one.
    #[getter]
    fn order(&self) -> u8 {
        self.0.order
    }

    fn __repr__(&self) -> String {
        let OpenFold {
            direction: [x, y, z],
            order,
            ..
        } = self.0;
        format!("Fold(direction=[{x:.3}, {y:.3}, {z:.3}], order={order})")
    }
}

/// An axis of the target about which the turn is open.
#[pyclass(module = "reagent", frozen)]
pub struct Axis(OpenAxis);

#[pymethods]
impl Axis {
    /// A point of it, in the target's coordinates: (3,), float64.
    #[getter]
    fn point<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_owned_array(py, arr1(&self.0.point))
    }

    /// Its unit vector: (3,), float64.
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_owned_array(py, arr1(&self.0.direction.map(f64::from)))
    }

    /// Least and largest turn about it that fit as well, degrees, by the right hand: the first is not positive, the second not
    /// negative.
    #[getter]
    fn range_deg(&self) -> (f32, f32) {
        self.0.range_deg.into()
    }

    fn __repr__(&self) -> String {
        let ([x, y, z], [least, most]) = (self.0.direction, self.0.range_deg);
        format!("Axis(direction=[{x:.3}, {y:.3}, {z:.3}], range_deg=({least:.0}, {most:.0}))")
    }
}

/// A direction along which the place is open.
#[pyclass(module = "reagent", frozen)]
pub struct Slide(OpenSlide);

#[pymethods]
impl Slide {
    /// Its unit vector, in the target's coordinates: (3,), float64.
    #[getter]
    fn direction<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_owned_array(py, arr1(&self.0.direction.map(f64::from)))
    }

    /// Least and largest shift along it that fit as well, in the target's unit.
    #[getter]
    fn range(&self) -> (f32, f32) {
        self.0.range.into()
    }

    fn __repr__(&self) -> String {
        let ([x, y, z], [least, most]) = (self.0.direction, self.0.range);
        format!("Slide(direction=[{x:.3}, {y:.3}, {z:.3}], range=({least:.3}, {most:.3}))")
    }
}
