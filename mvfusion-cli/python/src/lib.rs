//! The native part of the Python package `mvfusion`. It hands over numbers as bytes, facts as JSON and configurations
//! as dicts; what users see is written in Python, in `python/mvfusion/`.

mod arrays;
mod compute;
mod error;
mod run;
mod train;
mod values;

use std::sync::Once;

use mvfusion_cli::args::OutputArgs;
use pyo3::prelude::*;

/// Sends warnings to stderr, or what `RUST_LOG` asks for.
fn start_logs() {
    static STARTED: Once = Once::new();
    STARTED.call_once(|| mvfusion_cli::logs::start(OutputArgs::default()));
}

#[pymodule]
mod _mvfusion {
    use super::*;

    #[pymodule_export]
    use error::{MvfusionError, UsageError};
    #[pymodule_export]
    use run::{NativeRun, check_camera};
    #[pymodule_export]
    use train::train;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        error::set_exit_codes(module.py())?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        start_logs();
        Ok(())
    }
}
