//! Arguments other than arrays. A refusal names the argument, whatever its value.

use crate::error::bad;
use host_train::policy::BUNDLED;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedStr;
use reagent_core::dims::MAX_POINTS;
use reagent_core::pipeline::Mode;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Range of policy steps, as on the command line.
const STEPS: RangeInclusive<usize> = 0..=65535;
/// Range of poses to report.
const COUNTS: RangeInclusive<usize> = 1..=65535;
/// Range of points that the policy may see.
const POINTS: RangeInclusive<usize> = 16..=MAX_POINTS;
/// Range of threads: no machine has so many cores that more would help.
const THREADS: RangeInclusive<usize> = 1..=512;

pub(crate) fn steps(given: &Bound<'_, PyAny>) -> PyResult<usize> {
    number("steps", given, STEPS)
}

pub(crate) fn best(given: &Bound<'_, PyAny>) -> PyResult<usize> {
    number("best", given, COUNTS)
}

pub(crate) fn points(given: &Bound<'_, PyAny>) -> PyResult<usize> {
    number("points", given, POINTS)
}

pub(crate) fn points_if_any(given: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    if_any(given, points)
}

pub(crate) fn threads_if_any(given: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    if_any(given, |given| number("threads", given, THREADS))
}

pub(crate) fn depth_scale(given: &Bound<'_, PyAny>) -> PyResult<f64> {
    let refused = |_| bad("depth_scale", "expected a positive number");
    given.extract().map_err(refused)
}

pub(crate) fn path(given: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    let refused = |_| {
        let found = given.get_type();
        bad(
            "path",
            format!("expected a file's name, as text or a pathlib.Path, found {found}"),
        )
    };
    given.extract().map_err(refused)
}

pub(crate) fn return_exceptions(given: &Bound<'_, PyAny>) -> PyResult<bool> {
    let refused = |_| bad("return_exceptions", "expected True or False");
    given.extract().map_err(refused)
}

/// The word given, if some argument knows it, also as a default; otherwise the empty word, which all arguments refuse.
pub(crate) fn word(given: &Bound<'_, PyAny>) -> PyResult<&'static str> {
    let given = given.extract::<PyBackedStr>().ok();
    let modes = Mode::ALL.map(Mode::name);
    let policies = BUNDLED.map(|(name, _)| name);
    let others = ["auto", "always", "never", "int8"];
    let mut known = modes.into_iter().chain(policies).chain(others);
    let word = known.find(|&word| given.as_ref().is_some_and(|given| **given == *word));
    Ok(word.unwrap_or_default())
}

fn number(name: &str, given: &Bound<'_, PyAny>, within: RangeInclusive<usize>) -> PyResult<usize> {
    let number = given.extract().ok();
    number
        .filter(|number| within.contains(number))
        .ok_or_else(|| {
            let (least, most) = within.into_inner();
            bad(
                name,
                format!("expected a whole number from {least} to {most}"),
            )
        })
}

pub(crate) fn if_any<T>(
    given: &Bound<'_, PyAny>,
    of: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
) -> PyResult<Option<T>> {
    (!given.is_none()).then(|| of(given)).transpose()
}
