//! `cargo xtask gpu`: everything that a machine with a GPU is asked, packed here and run there.
//!
//! That machine needs neither Rust nor a network. `pack` makes a folder with the programs, the oracles and `run.sh`,
//! and an archive of it. `run` goes through the list of [`list`], and writes what it found as JSON and as a Markdown
//! table after each entry, so that an interruption loses nothing.

mod answer;
mod list;
mod outcome;
mod pack;
mod process;
mod run;

use anyhow::Result;
use clap::{Args, Subcommand};

/// Packs what a machine with a GPU is asked, or runs it there.
#[derive(Debug, Args)]
pub struct GpuArguments {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Builds the programs and packs them with the oracles.
    Pack(pack::PackArguments),
    /// Runs the list in the folder that `pack` made.
    Run(run::RunArguments),
}

/// Packs or runs.
pub fn run(arguments: &GpuArguments) -> Result<()> {
    match &arguments.action {
        Action::Pack(arguments) => pack::run(arguments),
        Action::Run(arguments) => run::run(arguments),
    }
}
