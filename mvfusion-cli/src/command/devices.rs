//! `mvfusion devices`: what was compiled in, and what was found.

use std::io::Write;

use crate::device;

/// Lists the devices that `--device` takes here.
///
/// # Errors
/// If `out` cannot be written to.
pub fn devices(out: &mut dyn Write) -> anyhow::Result<()> {
    for line in device::list() {
        writeln!(out, "{line}")?;
    }
    Ok(())
}
