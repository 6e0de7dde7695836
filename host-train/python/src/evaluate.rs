//! Errors of poses, as `host-train eval` reports them.

use crate::array::{Poses, poses};
use crate::cloud::Cloud;
use crate::error::{Error, bad};
use crate::json::as_json;
use host_train::dataset::Point;
use host_train::measure::metrics::{GroundTruth, PairMetrics, Summary};
use host_train::pose64::Pose64;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use reagent_core::Pose;

/// Computes errors of poses against the true ones, as a dict: what `host-train eval --json` reports of a method.
///
/// `found` and `truth` are arrays of poses (M, 4, 4) or (M, 3, 4). `sources` and `targets` are M clouds each; `raw`, if
/// known, are M clouds in the targets' place without noise. Rotations are in degrees, translations in the clouds' unit.
/// `recall_r5_t005` counts poses within 5 degrees and .05 units, which is meant for clouds of radius 1.
///
/// >>> import numpy, reagent
/// >>> clouds = numpy.random.default_rng(1).normal(size=(2, 100, 3))
/// >>> truth = numpy.stack([numpy.eye(4)] * 2)
/// >>> found = truth.copy()
/// >>> found[1, 0, 3] = 0.5
/// >>> errors = reagent.evaluate(found, truth, clouds, clouds)
/// >>> errors["pairs"], errors["t_iso"], errors["recall_r5_t005"]
/// (2, 0.25, 0.5)
#[pyfunction]
#[pyo3(signature = (found, truth, sources, targets, *, raw = None))]
pub(crate) fn evaluate<'py>(
    py: Python<'py>,
    found: &Bound<'py, PyAny>,
    truth: &Bound<'py, PyAny>,
    sources: &Bound<'py, PyAny>,
    targets: &Bound<'py, PyAny>,
    raw: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    if found.len().is_ok_and(|pairs| pairs == 0) {
        return Err(Error::new_err("the set holds no pairs"));
    }
    let found = each_pose("found", found)?;
    let pairs = found.len();
    let counted = |name: &str, count: usize| match count == pairs {
        true => Ok(()),
        false => Err(bad(
            name,
            format!("expected one for each of {pairs} poses, found {count}"),
        )),
    };
    let truth = each_pose("truth", truth)?;
    counted("truth", truth.len())?;
    let clouds = |name: &str, given: &Bound<'py, PyAny>| {
        let items = given
            .try_iter()
            .map_err(|_| bad(name, "expected a sequence of clouds"))?
            .enumerate();
        let points =
            items.map(|(i, item)| Ok(Cloud::new(format!("{name}[{i}]"), &item?)?.view().points()));
        let points = points.collect::<PyResult<Vec<Vec<Point>>>>()?;
        counted(name, points.len())?;
        Ok::<_, PyErr>(points)
    };
    let (sources, targets) = (clouds("sources", sources)?, clouds("targets", targets)?);
    let raw = raw.map(|raw| clouds("raw", raw)).transpose()?;
    let measured = py.detach(|| {
        let measure = |i: usize| {
            let raw = raw.as_ref().map(|raw| raw[i].as_slice());
            let truth = GroundTruth::new(&sources[i], &targets[i], raw, truth[i]);
            let truth = truth.map_err(|error| bad(&format!("pair {i}"), error))?;
            Ok(truth.measure(found[i]))
        };
        (0..pairs)
            .map(measure)
            .collect::<PyResult<Vec<PairMetrics>>>()
    })?;
    let errors = as_json(py, &Summary::of(&measured))?;
    errors.cast::<PyDict>()?.set_item("pairs", pairs)?;
    Ok(errors)
}

/// One pose for each pair, in f32.
fn each_pose(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<Pose>> {
    let near = |pose: Pose64| pose.near([0.0; 3], [0.0; 3]);
    match poses(name, given)? {
        Poses::Each(poses) => Ok(poses.into_iter().map(near).collect()),
        Poses::One(_) => Err(bad(
            name,
            "expected poses of several pairs, (M, 4, 4) or (M, 3, 4)",
        )),
    }
}
