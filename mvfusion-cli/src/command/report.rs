//! `mvfusion report`.

use std::io::Write;

use crate::args::ReportArgs;
use crate::report;

/// Rebuilds the report of a run and prints its path.
///
/// # Errors
/// If the folder is not a run, or the file cannot be written.
pub fn report(args: &ReportArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    Ok(writeln!(out, "{}", report::write(&args.run)?.display())?)
}
