//! The program `mvfusion`: everything but `main`, so that other programs and tests can call it.
//!
//! The crate stands on top of `mvfusion-model`, which trains and evaluates. It adds what a user of a terminal needs:
//! presets, run folders, progress, a report, exports, animations and sweeps. It contains no mathematics.
//!
//! # A command from Rust
//! ```
//! use clap::Parser;
//! use mvfusion_cli::Cli;
//!
//! # fn main() -> anyhow::Result<()> {
//! let cli = Cli::try_parse_from(["mvfusion", "config", "--set", "train.scale=0.1"])?;
//! let mut out = Vec::new();
//! mvfusion_cli::run(&cli, 1, &mut out)?;
//! assert!(String::from_utf8(out)?.contains("scale = 0.1"));
//! # Ok(())
//! # }
//! ```
//!
//! # Which module do I use?
//! | you want to | look at |
//! |---|---|
//! | know what a command does | [`command`], one file for each command, and [`args`], its options |
//! | merge a preset, files and `--set` into a configuration | [`config`] |
//! | find the files of a run | [`mod@run`] |
//! | build the report of a run | [`report`] |
//! | write Gaussians for other programs | [`export`] |
//! | train from a program of yours, told of each step | [`command::train_observed`]; the Python package does so |
//! | render images and animations | [`render`] |
//! | serve the viewer | `viewer`, with the feature of that name |
//! | write the curves of a run for TensorBoard | [`tensorboard`] |
//! | train many runs and compare them in a table | [`sweep`] |
//!
//! # Which crate do I use?
//! To train or render from your own program, use `mvfusion-model`. `mvfusion-data` reads and writes scenes, and
//! `mvfusion-render` splats Gaussians. This crate is for programs that want the commands themselves.

pub mod args;
pub mod atomic;
pub mod clock;
pub mod command;
pub mod config;
pub mod device;
mod drawing;
pub mod export;
pub mod failure;
mod help;
pub mod interrupt;
mod level_axes;
pub mod lock;
pub mod logs;
pub mod lpips;
mod machine;
pub mod memory;
mod program;
pub mod progress;
pub mod render;
pub mod report;
pub mod run;
pub mod scene;
pub mod stdout;
pub mod sweep;
pub mod table;
pub mod tensorboard;
pub mod threads;
#[cfg(feature = "viewer")]
pub mod viewer;

use std::io::Write;

use anyhow::Context;
pub use args::Cli;
use args::Command;

/// Carries out a command line with the given number of CPU threads. What the command was asked for goes to `out`;
/// progress, notes and logs go to stderr.
///
/// # Errors
/// Whatever the command fails with; [`failure::exit_code`] knows the exit code.
pub fn run(cli: &Cli, threads: usize, out: &mut dyn Write) -> anyhow::Result<()> {
    logs::start(cli.output);
    interrupt::survive_file_limits().context("cannot watch for signals")?;
    threads::start(threads)?;
    let verbosity = cli.output.verbosity();
    if let Some(asked) = cli.command.threads().filter(|asked| asked.get() > threads) {
        verbosity.note(&format!("note:   {threads} threads are used, not {asked}: more do not help on this machine"));
    }
    match &cli.command {
        Command::Train(args) => command::train(args, verbosity, out),
        Command::Eval(args) => command::eval(args, verbosity, out),
        Command::Export(args) => command::export(args, verbosity, out),
        Command::Check(args) => command::check(args, verbosity, out),
        Command::Prepare(args) => command::prepare(args, verbosity, out),
        Command::Synth(args) => command::synth(args, verbosity, out),
        Command::Config(args) => command::config(args, verbosity, out),
        Command::LpipsWeights(args) => command::lpips_weights(args, out),
        Command::Presets(args) => command::presets(args, out),
        Command::Devices(args) => command::devices(args, out),
        Command::Completions(args) => command::completions(args, out),
        Command::Man(args) => command::man(args, out),
        Command::Render(args) => command::render(args, verbosity, out),
        #[cfg(feature = "viewer")]
        Command::View(args) => command::view(args, verbosity, out),
        Command::Report(args) => command::report(args, verbosity, out),
        Command::Restore(args) => command::restore(args, out),
        Command::Sweep(args) => command::sweep(args, verbosity, out),
    }
}
