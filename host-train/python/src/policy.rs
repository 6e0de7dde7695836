//! Policies that Python holds.

use crate::arguments;
use crate::error::{bad, bad_policy};
use host_train::policy::{BUNDLED, REAGENT, VIEWS, WeightFile};
use host_train::register::request::Request;
use pyo3::prelude::*;
use reagent_core::weights;
use self_cell::self_cell;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

self_cell!(
    /// A policy and the bytes that it refers to, checked and packed once.
    struct Checked {
        owner: WeightFile,
        #[covariant]
        dependent: View,
    }
);

type View<'a> = weights::Policy<'a>;

/// A policy: the network, and how steps follow from its outputs.
///
/// >>> import reagent
/// >>> reagent.Policy.pretrained("int8")
/// Policy('int8', format='int8')
#[pyclass(module = "reagent", frozen, from_py_object)]
#[derive(Clone)]
pub struct Policy {
    name: String,
    checked: Arc<Checked>,
}

/// The default policies, those of the command line: for whole clouds and for views.
static DEFAULTS: [OnceLock<Policy>; 2] = [const { OnceLock::new() }; 2];

impl Policy {
    fn new(name: String, file: WeightFile) -> Policy {
        Policy {
            name,
            checked: Arc::new(Checked::new(file, WeightFile::policy)),
        }
    }

    fn bundled(name: &str) -> Option<Policy> {
        let file = match name {
            "int8" => WeightFile::from_bytes(weights::Policy::pretrained_int8_bytes()).ok(),
            _ => WeightFile::bundled(Path::new(name)),
        };
        Some(Policy::new(name.into(), file?))
    }

    /// The default policy for a request, as on the command line.
    pub(crate) fn fitting(request: &Request) -> &'static Policy {
        let is_view = request.view_point.is_some();
        let name = if is_view { VIEWS } else { REAGENT };
        let bundled = || Policy::bundled(name).expect("it is linked in");
        DEFAULTS[usize::from(is_view)].get_or_init(bundled)
    }

    pub(crate) fn view(&self) -> weights::Policy<'_> {
        *self.checked.borrow_dependent()
    }
}

/// A policy as an argument.
pub(crate) fn if_any(given: &Bound<'_, PyAny>) -> PyResult<Option<Policy>> {
    arguments::if_any(given, |given| {
        let expected = "expected a Policy, such as Policy.pretrained(\"int8\")";
        given
            .extract::<Policy>()
            .map_err(|_| bad("policy", expected))
    })
}

#[pymethods]
impl Policy {
    /// One of the policies that come with the package: "reagent" (float32, the command line's), "int8" (the same in 8-bit
    /// integers, with the same bits on every processor), "compact" (int8, a tenth of the size), "views" and "views-compact"
    /// (int8, for a source that is one depth view of the target, with a start near it).
    #[staticmethod]
    #[pyo3(signature = (name = "reagent"))]
    pub(crate) fn pretrained(
        #[pyo3(from_py_with = arguments::word)] name: &str,
    ) -> PyResult<Policy> {
        let names = BUNDLED.map(|(name, _)| name).join(", ");
        Policy::bundled(name).ok_or_else(|| bad("name", format!("expected int8, {names}")))
    }

    /// Reads a policy file (.rgw), as `host-train export` writes it.
    ///
    /// Raises OSError if it cannot be read, and PolicyError if it is not a policy.
    #[staticmethod]
    fn load(
        py: Python<'_>,
        #[pyo3(from_py_with = arguments::path)] path: PathBuf,
    ) -> PyResult<Policy> {
        // A bare name would stand for a bundled policy.
        let path = std::path::absolute(path)?;
        let file = py.detach(|| WeightFile::load(&path));
        let file = file.map_err(|error| bad_policy(&error))?;
        let stem = path.file_stem().unwrap_or_default();
        Ok(Policy::new(stem.to_string_lossy().into_owned(), file))
    }

    /// The file's stem, or the name of a policy that comes with the package.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// "f32" or "int8".
    #[getter]
    fn format(&self) -> &'static str {
        match self.view().f32() {
            Some(_) => "f32",
            None => "int8",
        }
    }

    /// SHA-256 of the file, in hexadecimal digits: the policy's identity in a fleet.
    #[getter]
    fn sha256(&self) -> String {
        const_hex::encode(self.checked.borrow_owner().sha256())
    }

    pub(crate) fn __repr__(&self) -> String {
        format!("Policy('{}', format='{}')", self.name, self.format())
    }
}
