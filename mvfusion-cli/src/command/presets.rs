//! `mvfusion presets`.

use std::io::Write;

use crate::config::PRESETS;

/// Lists the presets, one line each.
///
/// # Errors
/// If `out` cannot be written to.
pub fn presets(out: &mut dyn Write) -> anyhow::Result<()> {
    for preset in PRESETS {
        writeln!(out, "{:26}{}", preset.name, preset.purpose)?;
    }
    Ok(())
}
