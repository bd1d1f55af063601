//! `mvfusion config`.

use std::io::Write;

use mvfusion_model::Config;

use crate::args::ConfigArgs;
use crate::config;
use crate::progress::Verbosity;

/// Prints the configuration that `train` would use, or what is known of its keys.
///
/// # Errors
/// As [`config::resolve`] and [`config::explain`], or if `out` cannot be written to.
pub fn config(args: &ConfigArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let text = match &args.explain {
        Some(key) => config::explain(key)?,
        None if args.schema => format!("{:#}\n", Config::schema()),
        None => {
            let resolved = config::resolve(&args.sources, args.data.as_deref())?;
            if let Some(note) = &resolved.note {
                verbosity.note(note);
            }
            if args.template { config::template(&resolved)? } else { config::to_toml(&resolved.config)? }
        }
    };
    Ok(out.write_all(text.as_bytes())?)
}
