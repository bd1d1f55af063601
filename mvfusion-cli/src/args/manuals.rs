//! `mvfusion completions` and `mvfusion man`.

use std::path::PathBuf;

use clap::Args;
use clap_complete::Shell;

/// `mvfusion completions`.
#[derive(Clone, Debug, Args)]
pub struct CompletionsArgs {
    /// Shell
    #[arg(value_name = "SHELL")]
    pub shell: Shell,
}

/// `mvfusion man`.
#[derive(Clone, Debug, Args)]
pub struct ManArgs {
    /// Output folder
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}
