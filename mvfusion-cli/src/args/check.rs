//! The arguments of `mvfusion check`.

use std::path::PathBuf;

use clap::Args;

use super::compute::ComputeArgs;
use super::config::ConfigSourceArgs;

/// `mvfusion check`.
#[derive(Clone, Debug, Args)]
pub struct CheckArgs {
    /// Scene folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// How the scene is read, and the configuration that would train on it.
    #[command(flatten)]
    pub sources: ConfigSourceArgs,
    /// Print the findings as JSON
    #[arg(long)]
    pub json: bool,
    /// Decode at most one image per camera
    ///
    /// Broken, empty and duplicate images may then go unnoticed.
    #[arg(long)]
    pub quick: bool,
    /// Output file for the points drawn over several photos [default: check-NAME.png]
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Do not draw the points over photos
    #[arg(long, conflicts_with = "picture")]
    pub no_picture: bool,
    /// Do not predict the time of a training
    ///
    /// The prediction trains for some seconds, at most about 20.
    #[arg(long)]
    pub no_time: bool,
    /// Device and threads for which the time is predicted.
    #[command(flatten)]
    pub compute: ComputeArgs,
}
