//! `mvfusion completions`.

use std::io::Write;

use clap::CommandFactory;

use crate::Cli;
use crate::args::CompletionsArgs;

/// Prints the completions of a shell.
///
/// # Errors
/// If `out` cannot be written to.
pub fn completions(args: &CompletionsArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    // The generator panics where it cannot write, for example into a closed pipe.
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "mvfusion", &mut script);
    Ok(out.write_all(&script)?)
}
