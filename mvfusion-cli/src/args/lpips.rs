//! The arguments of `mvfusion lpips-weights`.

use std::path::PathBuf;

use clap::Args;

/// `mvfusion lpips-weights`.
#[derive(Clone, Debug, Args)]
pub struct LpipsWeightsArgs {
    /// Files of torchvision (.pth), the wheel of the package lpips (.whl), or folders with them; may be repeated
    #[arg(long, value_name = "PATH", required = true, num_args = 1..)]
    pub from: Vec<PathBuf>,
    /// Output folder [default: the one that `train` and `eval` look into by themselves]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace other weights in the output folder
    #[arg(long)]
    pub force: bool,
}
