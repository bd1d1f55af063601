//! Logs on stderr: warnings by default, more with `-v` or `RUST_LOG`; as JSON with `--progress json`.

use std::io::{self, IsTerminal};

use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;

use crate::args::OutputArgs;
use crate::progress::LogLayer;

/// Starts logging. A second call, as in tests, changes nothing.
pub fn start(output: OutputArgs) {
    let level = match (output.quiet, output.verbose) {
        (true, _) => "error",
        (false, 0) => "warn",
        (false, 1) => "warn,mvfusion_data=info,mvfusion_model=info,mvfusion_render=info,mvfusion_cli=info",
        (false, _) => "info,mvfusion_data=debug,mvfusion_model=debug,mvfusion_render=debug,mvfusion_cli=debug",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
    if output.verbosity().is_json() {
        if let Err(error) = tracing_subscriber::registry().with(filter).with(LogLayer).try_init() {
            tracing::debug!("logging was started before: {error}");
        }
        return;
    }
    let started = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .without_time()
        .with_target(false)
        // These would be reported on stderr, and a closed stderr must not end a command.
        .log_internal_errors(false)
        .try_init();
    if let Err(error) = started {
        tracing::debug!("logging was started before: {error}");
    }
}
