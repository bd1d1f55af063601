//! `mvfusion train`.

mod begin;
#[cfg(feature = "viewer")]
mod live;
#[cfg(not(feature = "viewer"))]
#[path = "no_live.rs"]
mod live;
mod resume;
mod scores;
mod session;
mod setup;
mod watch;

use std::io::{self, Write};
use std::path::PathBuf;

use anyhow::Context;

use crate::args::TrainArgs;
use crate::interrupt::Signals;
use crate::progress::Verbosity;
#[cfg(feature = "viewer")]
use crate::viewer::address::BoundSocket;
use begin::begun;
use resume::resumed;
use session::Session;

pub use session::Observer;

/// Trains on a scene, evaluates, and writes a run folder.
///
/// # Errors
/// For an invalid command line, before anything is written. Later, if the device fails, the loss is not finite, or a
/// file cannot be written. [`Interrupted`](crate::interrupt::Interrupted) after a signal, once the run is saved.
pub fn train(args: &TrainArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let signals = Signals::watch().context("cannot watch for signals")?;
    let socket = live::bind_viewer(args)?;
    let ended = trained(args, signals.clone(), socket, verbosity, out);
    if ended.is_ok() {
        // Nobody asks for signals any more, and a sweep's cell goes on.
        signals.end_at_once();
    }
    ended
}

/// The same in a thread of a program: with signals of its own, and a viewer at a socket that listens already.
///
/// # Errors
/// As [`train`].
#[cfg(feature = "viewer")]
pub fn train_in_thread(
    args: &TrainArgs,
    signals: Signals,
    viewer: Option<BoundSocket>,
    verbosity: Verbosity,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    trained(args, signals, viewer, verbosity, out)
}

/// The same for a program that embeds this one: with signals of its own, and an observer. Returns the run folder.
///
/// # Errors
/// As [`train`]; [`Interrupted`](crate::interrupt::Interrupted) also if the observer ended it.
pub fn train_observed(
    args: &TrainArgs,
    signals: Signals,
    observer: Option<Observer>,
    verbosity: Verbosity,
) -> anyhow::Result<PathBuf> {
    let session = opened(args, signals, verbosity)?;
    let folder = session.folder.path().to_owned();
    Session { observer, ..session }.run(&mut io::sink())?;
    Ok(folder)
}

fn trained(
    args: &TrainArgs,
    signals: Signals,
    socket: live::ViewerSocket,
    verbosity: Verbosity,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let session = opened(args, signals, verbosity)?;
    let path = session.folder.path().to_owned();
    let ended = session.watched(socket).and_then(|session| session.run(out));
    // A run that fails at its first step takes its folder with it.
    if path.is_dir() {
        verbosity.wrote("run", &path);
    }
    ended
}

/// A training before its first step in this process.
fn opened(args: &TrainArgs, signals: Signals, verbosity: Verbosity) -> anyhow::Result<Session> {
    match &args.resume {
        Some(run) => resumed(args, run, signals, verbosity),
        None => begun(args, signals, verbosity),
    }
}
