//! `mvfusion presets`.

use std::io::Write;

use serde::Serialize;

use super::json;
use crate::args::ListArgs;
use crate::config::PRESETS;

/// A preset, for scripts.
#[derive(Serialize)]
struct Listed {
    name: &'static str,
    purpose: &'static str,
    /// The preset that it builds on; absent for the defaults of all keys.
    #[serde(skip_serializing_if = "Option::is_none")]
    base: Option<&'static str>,
}

/// Lists the presets, one line each.
///
/// # Errors
/// If `out` cannot be written to.
pub fn presets(args: &ListArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    if args.json {
        let listed =
            PRESETS.iter().map(|preset| Listed { name: preset.name, purpose: preset.purpose, base: preset.base });
        return json::print(&listed.collect::<Vec<_>>(), out);
    }
    for preset in PRESETS {
        writeln!(out, "{:26}{}", preset.name, preset.purpose)?;
    }
    Ok(())
}
