//! Errors of the core as exceptions, with the same words.

use coupling::error::CouplingError;
use multibody::InputError as CoreInputError;
use pyo3::PyErr;
use pyo3::exceptions::{PyRuntimeError, PyValueError};

pyo3::create_exception!(
    sartorius,
    InputError,
    PyValueError,
    "An input cannot be used. The message names file, place, value and remedy, and all mistakes at once."
);
pyo3::create_exception!(
    sartorius,
    NotConverged,
    PyRuntimeError,
    "The input is good, but there is no solution. The message says where and why."
);

/// The exception of an error: what ends the command with exit code 3 is no mistake of the input.
pub(crate) fn of_core(error: CouplingError) -> PyErr {
    match error.exit_code() {
        3 => NotConverged::new_err(error.to_string()),
        _ => InputError::new_err(error.to_string()),
    }
}

/// The exception of a file that cannot be used.
pub(crate) fn of_input(error: CoreInputError) -> PyErr {
    InputError::new_err(error.to_string())
}

/// The exception of what the caller gave.
pub(crate) fn bad(words: impl Into<String>) -> PyErr {
    InputError::new_err(words.into())
}
