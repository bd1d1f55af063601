//! `mvfusion config`.

use std::io::Write;

use crate::args::ConfigArgs;
use crate::config;
use crate::progress::Verbosity;

/// Prints the configuration that `train` would use.
///
/// # Errors
/// As [`config::resolve`], or if `out` cannot be written to.
pub fn config(args: &ConfigArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let resolved = config::resolve(&args.sources, args.data.as_deref())?;
    if let Some(note) = &resolved.note {
        verbosity.note(note);
    }
    Ok(out.write_all(config::to_toml(&resolved.config)?.as_bytes())?)
}
