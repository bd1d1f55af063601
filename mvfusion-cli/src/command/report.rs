//! `mvfusion report`.

use std::io::Write;

use crate::args::ReportArgs;
use crate::progress::Verbosity;
use crate::{report, run};

/// Rebuilds the report of a run and prints its path.
///
/// # Errors
/// If the folder is not a run, or the file cannot be written.
pub fn report(args: &ReportArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    if let Some(note) = run::waiting_note(&args.run) {
        verbosity.note(&format!("note:   {note}"));
    }
    let report = report::write(&args.run)?;
    verbosity.wrote("report", &report);
    Ok(writeln!(out, "{}", report.display())?)
}
