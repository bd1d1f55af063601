//! `mvfusion report`.

use std::io::Write;

use crate::args::ReportArgs;
use crate::report;

/// Writes the report of a run anew and says where it lies.
///
/// # Errors
/// If the folder is no run, or the file cannot be written.
pub fn report(args: &ReportArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    Ok(writeln!(out, "{}", report::write(&args.run)?.display())?)
}
