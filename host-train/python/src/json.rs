//! Conversion of what Rust writes as JSON to Python objects.

use pyo3::prelude::*;
use pythonize::pythonize;
use serde::Serialize;

/// A value as dicts, lists, strings and numbers.
pub(crate) fn as_json<'py>(py: Python<'py>, of: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let value = serde_json::to_value(of).expect("plain numbers and words");
    Ok(pythonize(py, &value)?)
}
