//! Computing beside Python.

use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;

use crate::error::raised;

/// Works without the interpreter's lock, on the process-wide pool of threads (`RAYON_NUM_THREADS`, or one a core).
///
/// One piece of work at a time: each uses all threads, and a thread of the pool that waits within one piece could begin
/// another.
///
/// # Errors
/// Those of the work, as exceptions.
pub fn compute<T: Send>(py: Python<'_>, work: impl FnOnce() -> anyhow::Result<T> + Send) -> PyResult<T> {
    static TURN: Mutex<()> = Mutex::new(());
    let worked = py.detach(|| {
        // What panicked left nothing behind.
        let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        rayon::scope(|_| work())
    });
    worked.map_err(|error| raised(&error))
}
