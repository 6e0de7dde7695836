//! Results as Python reads them.

use crate::array::matrix;
use crate::json::as_json;
use crate::step::Step;
use crate::undetermined::Undetermined;
use host_train::pose64::Position;
use host_train::register::document::{Document, Fit, OtherPose};
use host_train::register::prepared::Prepared;
use host_train::register::request::Done;
use host_train::register::sentences::Remark;
use host_train::register::trace;
use numpy::ndarray::{arr1, arr2};
use numpy::{PyArray1, PyArray2};
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
