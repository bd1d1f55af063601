//! The options for device and threads.

use std::num::NonZeroUsize;

use clap::Args;

use super::numbers::parse_count;
use crate::device;

/// Device and threads.
#[derive(Clone, Debug, Args)]
pub struct ComputeArgs {
    /// Device: auto (a GPU if available), cpu, flex, ndarray, wgpu, wgpu:N, cuda or cuda:N (see `mvfusion devices`)
    #[arg(long, value_name = "D", default_value = device::AUTO)]
    pub device: String,
    /// CPU threads; the result does not depend on their number [default: all cores]
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub threads: Option<NonZeroUsize>,
}

impl Default for ComputeArgs {
    fn default() -> Self {
        Self { device: device::AUTO.to_owned(), threads: None }
    }
}
