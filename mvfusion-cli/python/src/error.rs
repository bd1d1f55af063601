//! Exceptions with the program's messages and exit codes.

use mvfusion_cli::failure::{self, FAILED, USAGE};
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    mvfusion,
    MvfusionError,
    PyException,
    "What the program would report and end with.\n\nAttributes\n----------\nexit_code : int\n    The exit code of the \
     program: 1 for a failure, 2 for what the user can mend.\n"
);
create_exception!(
    mvfusion,
    UsageError,
    MvfusionError,
    "An argument, a configuration or a name that the user can mend; ``exit_code`` is 2.\n"
);

/// Gives both exceptions the exit code of their kind.
pub fn set_exit_codes(py: Python<'_>) -> PyResult<()> {
    py.get_type::<MvfusionError>().setattr("exit_code", FAILED)?;
    py.get_type::<UsageError>().setattr("exit_code", USAGE)
}

/// The exception of an error: its causes as one paragraph.
pub fn raised(error: &anyhow::Error) -> PyErr {
    let message = failure::paragraph(error);
    match failure::exit_code(error) {
        USAGE => UsageError::new_err(message),
        _ => MvfusionError::new_err(message),
    }
}
