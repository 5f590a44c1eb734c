//! Why a call failed: a Python exception, or a core error that becomes one.

use phasestereo::Error;
use pyo3::PyErr;
use pyo3::exceptions::{PyMemoryError, PyRuntimeError, PyValueError};

/// The exception that a call raises.
#[derive(Debug)]
pub struct Failure(PyErr);

/// Results of this crate.
pub type Result<T> = std::result::Result<T, Failure>;

impl From<PyErr> for Failure {
    fn from(exception: PyErr) -> Self {
        Self(exception)
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let message = error.to_string();
        Self(match error {
            Error::Value { .. } => PyValueError::new_err(message),
            Error::OutOfMemory { .. } => PyMemoryError::new_err(message),
            // The enum may grow; variants unknown here are not faults of an argument.
            _ => PyRuntimeError::new_err(message),
        })
    }
}

impl From<Failure> for PyErr {
    fn from(Failure(exception): Failure) -> Self {
        exception
    }
}
