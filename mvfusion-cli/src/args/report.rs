//! The arguments of `mvfusion report`.

use std::path::PathBuf;

use clap::Args;

/// `mvfusion report`.
#[derive(Clone, Debug, Args)]
pub struct ReportArgs {
    /// Run folder
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
}
