//! Output for other programs: one JSON value on stdout.

use std::io::Write;

use serde::Serialize;

/// Prints a value as indented JSON, numbers in full precision.
///
/// # Errors
/// If `out` cannot be written to.
pub(super) fn print(value: &impl Serialize, out: &mut dyn Write) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value)?;
    Ok(writeln!(out, "{text}")?)
}
