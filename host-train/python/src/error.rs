//! Errors as exceptions, in the words of the command line.

use host_train::dataset::cloud_file;
use host_train::policy::ExportError;
use pyo3::create_exception;
use pyo3::exceptions::{PyFileNotFoundError, PyOSError, PyValueError};
use pyo3::prelude::*;
use std::error;

create_exception!(
    reagent,
    Error,
    PyValueError,
    "What cannot be registered: a start, an option, a pair of clouds."
);
create_exception!(
    reagent,
    CloudError,
    Error,
    "A cloud that cannot be registered. The message names the argument."
);
create_exception!(reagent, PolicyError, Error, "A file that is no policy.");

/// The error for an argument with this name.
pub(crate) fn bad(name: &str, what: impl std::fmt::Display) -> PyErr {
    Error::new_err(format!("{name}: {what}"))
}

/// The error for a refused cloud, which carries its name.
pub(crate) fn bad_cloud(error: &cloud_file::CloudError) -> PyErr {
    CloudError::new_err(error.to_string())
}

/// The error for a policy that was not loaded; an `OSError` if the file cannot be read.
pub(crate) fn bad_policy(error: &ExportError) -> PyErr {
    let text = chain(error);
    match error {
        ExportError::Read { source, .. } => std::io::Error::new(source.kind(), text).into(),
        // Bundled policies have a function of their own.
        ExportError::Missing { path } => PyFileNotFoundError::new_err(format!(
            "cannot read {}: there is no such file",
            path.display()
        )),
        _ => PolicyError::new_err(text),
    }
}

/// The error for threads that the system refused.
pub(crate) fn no_threads(error: &dyn error::Error) -> PyErr {
    PyOSError::new_err(format!("cannot start threads: {}", chain(error)))
}

/// An error and its causes in one line.
fn chain(error: &dyn error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text += &format!(": {error}");
        cause = error.source();
    }
    text
}
