//! Exceptions of the Python package.

use std::error::Error as _;

use genmanip_workspace::WorkspaceError;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

create_exception!(
    genmanip,
    Error,
    PyValueError,
    "What could not be done, why, and what helps; each on lines of its own."
);

/// The error with those behind it, and its hint on a line of its own.
pub fn raised(error: &WorkspaceError) -> PyErr {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        text += &format!(": {cause}");
        next = cause.source();
    }
    if let Some(hint) = error.hint() {
        text += &format!("\nhint: {hint}");
    }
    Error::new_err(text)
}

/// As [`raised`], for `map_err`.
pub fn error(error: WorkspaceError) -> PyErr {
    raised(&error)
}

/// JSON that a program gave.
pub fn read_json<T: serde::de::DeserializeOwned>(what: &str, text: &str) -> PyResult<T> {
    serde_json::from_str(text).map_err(|error| Error::new_err(format!("{what}: {error}")))
}

/// JSON for a program; the package turns it into dictionaries.
pub fn json(value: &impl serde::Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| Error::new_err(error.to_string()))
}
