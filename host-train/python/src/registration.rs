//! Results as Python reads them.

use crate::array::matrix;
use crate::json::as_json;
use crate::step::Step;
use host_train::pose64::Position;
use host_train::register::document::{
    Document, Fit, Open, OpenAxis, OpenFold, OpenSlide, OtherPose,
};
use host_train::register::prepared::Prepared;
use host_train::register::request::Done;
use host_train::register::sentences::Remark;
use host_train::register::trace;
use numpy::ndarray::{Array3, arr1, arr2};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use reagent_core::track::TrackState;
use reagent_core::verdict::Verdict;

/// A pose, and what can be said about it. Coordinates and lengths are the clouds' own.
#[pyclass(module = "reagent", frozen)]
pub struct Registration {
    document: Document,
    trace: Vec<trace::Step>,
    verdict: Verdict,
    origins: [Position; 2],
    state: Option<TrackState>,
    /// What is to be known besides the document's notes.
    remarks: Vec<String>,
}

impl Registration {
    /// Of clouds of which the so many most probable poses were asked for.
    pub(crate) fn new(clouds: [&Prepared<'_>; 2], done: Done, best: usize) -> Registration {
        let mut document = Document::new(clouds, &done, 1.0);
        document.others = document.others.filter(|_| best > 1);
        let [source, target] = clouds;
        let remarks = Remark::all(&done).into_iter().filter(|remark| {
            use Remark::{LeftOut, Mirrored, SizesDiffer};
            matches!(remark, LeftOut(_) | Mirrored | SizesDiffer(_))
        });
        let remarks = remarks
            .map(|remark| remark.sentence(["source", "target"]))
            .collect();
        Registration {
            document,
            remarks,
            trace: done.found.trace,
            verdict: done.found.answer.verdict,
            origins: [source.origin, target.origin],
            state: None,
        }
    }

    /// The same, of a cloud in which an object was looked for.
    pub(crate) fn with_state(self, state: TrackState) -> Registration {
        Registration {
            state: Some(state),
            ..self
        }
    }

    fn fit(&self) -> Option<&Fit> {
        self.document.fit.as_ref()
    }
}

#[pymethods]
impl Registration {
    /// The rigid transform from the source's coordinates to the target's: (4, 4), float64.
    #[getter]
    fn target_from_source<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, self.document.target_from_source)
    }

    /// "converged" where the pose may be used; else "poor fit", "sizes differ", "too few points", "mirrored", and of mode fast
    /// "step limit", "oscillating", "out of range".
    #[getter]
    fn verdict(&self) -> &str {
        &self.document.verdict
    }

    /// Whether the verdict is "converged".
    #[getter]
    fn converged(&self) -> bool {
        self.verdict == Verdict::Converged
    }

    /// That the pose is within 5 degrees and .05 target radii of the truth, or not to be told from it
    /// (ADI below .02 diameters), up to what is undetermined; None in mode fast.
    #[getter]
    fn probability(&self) -> Option<f32> {
        self.document.probability
    }

    /// Share of the source's points that lie on the target's surface; None in mode fast.
    #[getter]
    fn overlap(&self) -> Option<f32> {
        self.fit().map(|fit| fit.overlap)
    }

    /// Root of the mean squared distance of those from it; None in mode fast, and where none does.
    #[getter]
    fn rmse(&self) -> Option<f32> {
        let fit = self.fit().filter(|fit| fit.overlap > 0.0);
        fit.map(|fit| fit.inlier_rmse)
    }

    /// Size of the source over that of the target; None in mode fast.
    #[getter]
    fn extents_ratio(&self) -> Option<f32> {
        self.fit().map(|fit| fit.extents_ratio)
    }

    /// What the shape leaves open; None where it was not looked for: in mode fast, and where the surface holds all turns in modes polish and refine.
    #[getter]
    fn undetermined(&self) -> Option<Undetermined> {
        self.fit()?.undetermined.clone().map(Undetermined)
    }

    /// How uncertain the pose is, if it is right: (6, 6), float64, of a turn about `covariance_about` (radians, the target's
    /// axes) and of a shift. None in mode fast.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        let matrix = self.fit()?.covariance.matrix;
        let wide = matrix.map(|row| row.map(f64::from));
        Some(PyArray2::from_owned_array(py, arr2(&wide)))
    }

    /// The point of the target about which the covariance turns: (3,), float64; None in mode fast.
    #[getter]
    fn covariance_about<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let about = self.fit()?.covariance.about;
        Some(PyArray1::from_owned_array(py, arr1(&about)))
    }

    /// What a cloud of a `Tracker` says of its object: "found", "tracked" or "lost"; None of any other registration.
    #[getter]
    fn state(&self) -> Option<String> {
        self.state.map(|state| state.to_string())
    }

    /// Which of several starts it came from, from 0; None where there was one.
    #[getter]
    fn start(&self) -> Option<usize> {
        self.document.start
    }

    /// The next best poses, the most probable first, as far as `best` asked for them.
    #[getter]
    fn others(&self) -> Vec<Other> {
        let others = self.document.others.iter().flatten();
        others.cloned().map(Other).collect()
    }

    /// The policy's steps, in the order taken.
    #[getter]
    fn steps(&self) -> Vec<Step> {
        let step = |taken: &trace::Step| Step::new(taken.clone(), self.origins);
        self.trace.iter().map(step).collect()
    }

    /// In words: what was done to the clouds, such as points that were left out, thinned or shifted, and what to look at, such as
    /// sizes that differ as those of units do.
    #[getter]
    fn notes(&self) -> Vec<String> {
        let notes = self.document.notes.iter();
        let notes = notes.map(|note| format!("{}: {}", note.of, note.text));
        notes.chain(self.remarks.iter().cloned()).collect()
    }

    /// Time of the computation, milliseconds.
    #[getter]
    fn ms(&self) -> f64 {
        self.document.ms
    }

    /// What `host-train register --json` writes, with every stage; it can be pickled.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        as_json(py, &self.document)
    }

    /// Itself: nothing of it changes.
    fn __copy__(this: Py<Self>) -> Py<Self> {
        this
    }

    /// The same.
    fn __deepcopy__(this: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        this
    }

    fn __repr__(&self) -> String {
        let mut text = format!("Registration(verdict='{}'", self.document.verdict);
        if let Some(probability) = self.document.probability {
            text += &format!(", probability={probability:.4}");
        }
        if let Some(fit) = self.fit() {
            text += &format!(", overlap={:.2}", fit.overlap);
        }
        if let Some(rmse) = self.rmse() {
            text += &format!(", rmse={rmse:.3e}");
        }
        if let Some(state) = self.state {
            text += &format!(", state='{state}'");
        }
        text + ")"
    }
}

/// A pose that was not given out, and how the clouds fit under it.
#[pyclass(module = "reagent", frozen)]
pub struct Other(OtherPose);

#[pymethods]
impl Other {
    /// The rigid transform from the source's coordinates to the target's: (4, 4), float64.
    #[getter]
    fn target_from_source<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        matrix(py, self.0.target_from_source)
    }

    /// That it is right: what would be said of it alone, and how much less probable it is than the pose given out.
    #[getter]
    fn probability(&self) -> f32 {
        self.0.probability
    }

    /// Share of the source's points that lie on the target's surface.
    #[getter]
    fn overlap(&self) -> f32 {
        self.0.overlap
    }

    /// Root of the mean squared distance of those from it.
    #[getter]
    fn rmse(&self) -> f32 {
        self.0.inlier_rmse
    }

    fn __repr__(&self) -> String {
        let OtherPose {
            probability,
            overlap,
            inlier_rmse,
            ..
        } = self.0;
        format!("Other(probability={probability:.3}, overlap={overlap:.2}, rmse={inlier_rmse:.3e})")
    }
}

/// What the shape leaves open. True where there is anything.
#[pyclass(module = "reagent", frozen)]
pub struct Undetermined(Open);

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
