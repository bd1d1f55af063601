//! The options of the viewer.

use std::path::PathBuf;

use clap::Args;

use super::compute::ComputeArgs;
use crate::viewer::address::{HOST, PORT};

/// The text of the default port, for clap.
const PORT_TEXT: &str = "8420";
const _: () = assert!(PORT == 8420);

/// `mvfusion view`.
#[derive(Clone, Debug, Args)]
pub struct ViewArgs {
    /// Run folder
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Scene folder, if it has moved since training
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Port of the page; 0 takes any free one
    #[arg(long, value_name = "N", default_value_t = PORT)]
    pub port: u16,
    /// Address to listen at; any but this machine's own (0.0.0.0 for all) adds a random token to the page's address
    #[arg(long, value_name = "ADDR", default_value = HOST)]
    pub host: String,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
}

/// The options of `mvfusion train` for the viewer.
#[derive(Clone, Debug, Args)]
pub struct TrainViewArgs {
    /// Serve a page on which the training can be watched, paused and saved (docs/viewer.md) [default port: 8420]
    ///
    /// Port 0 takes any free one. The result of the training does not depend on who watches.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = PORT_TEXT)]
    pub view: Option<u16>,
    /// Address at which the page is served; any but this machine's own adds a random token to the page's address
    #[arg(long, value_name = "ADDR", default_value = HOST, requires = "view")]
    pub host: String,
}

impl Default for TrainViewArgs {
    fn default() -> Self {
        Self { view: None, host: HOST.to_owned() }
    }
}
