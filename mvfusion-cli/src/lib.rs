//! The inside of the `mvfusion` program: everything but `main`, so that it can be tested.
//!
//! [`command`] holds a file for each command; [`config`] merges the layers of the configuration; [`mod@run`] knows the
//! files of a run's folder, [`report`] makes a page of them; [`export`] writes those for other programs, [`render`]
//! films; [`sweep`] runs many of them and makes tables; [`progress`] and [`table`] are what the user sees. No
//! mathematics here: that is `mvfusion-model`.

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
mod logs;
pub mod progress;
pub mod render;
pub mod report;
pub mod run;
pub mod scene;
pub mod sweep;
pub mod table;
pub mod threads;

use std::io::Write;

pub use args::Cli;
use args::Command;

/// Carries out a command line with the given number of CPU threads. What the command was asked for goes to `out`;
/// progress, notes and logs go to stderr.
///
/// # Errors
/// Whatever the command fails with; [`failure::exit_code`] knows the exit code.
pub fn run(cli: &Cli, threads: usize, out: &mut dyn Write) -> anyhow::Result<()> {
    logs::start(cli.output);
    threads::start(threads)?;
    let verbosity = cli.output.verbosity();
    match &cli.command {
        Command::Train(args) => command::train(args, verbosity, out),
        Command::Eval(args) => command::eval(args, verbosity, out),
        Command::Export(args) => command::export(args, verbosity, out),
        Command::Check(args) => command::check(args, verbosity, out),
        Command::Synth(args) => command::synth(args, verbosity, out),
        Command::Config(args) => command::config(args, verbosity, out),
        Command::Presets => command::presets(out),
        Command::Devices => command::devices(out),
        Command::Render(args) => command::render(args, verbosity, out),
        Command::Report(args) => command::report(args, out),
        Command::Sweep(args) => command::sweep(args, verbosity, out),
    }
}
