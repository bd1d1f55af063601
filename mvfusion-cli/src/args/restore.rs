//! The arguments of `mvfusion restore`.

use std::path::PathBuf;

use clap::Args;

/// `mvfusion restore`.
#[derive(Clone, Debug, Args)]
pub struct RestoreArgs {
    /// Folder of the run, or of the export
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Remove the unfinished run, even if it could be continued
    #[arg(long)]
    pub force: bool,
}
