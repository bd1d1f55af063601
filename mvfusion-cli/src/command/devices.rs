//! `mvfusion devices`: the compiled backends and the detected devices.

use std::io::Write;

use crate::device;

/// Lists the devices that `--device` accepts in this build.
///
/// # Errors
/// If `out` cannot be written to.
pub fn devices(out: &mut dyn Write) -> anyhow::Result<()> {
    for line in device::list() {
        writeln!(out, "{line}")?;
    }
    Ok(())
}
