//! `mvfusion devices`: the compiled backends and the detected devices.

use std::io::Write;

use super::json;
use crate::args::ListArgs;
use crate::device;

/// Lists the devices that `--device` accepts in this build.
///
/// # Errors
/// If `out` cannot be written to.
pub fn devices(args: &ListArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    if args.json {
        return json::print(&device::listed(), out);
    }
    for line in device::list() {
        writeln!(out, "{line}")?;
    }
    Ok(())
}
