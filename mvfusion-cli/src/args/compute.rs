//! The options that say what computes.

use std::num::NonZeroUsize;

use clap::Args;

/// What computes.
#[derive(Clone, Debug, Args)]
pub struct ComputeArgs {
    /// auto (a GPU if there is one), cpu, flex, ndarray, wgpu or cuda, with :N for the N-th (see `mvfusion devices`)
    #[arg(long, value_name = "D", default_value = "auto")]
    pub device: String,
    /// CPU threads; the result does not depend on it [default: all cores]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
}
