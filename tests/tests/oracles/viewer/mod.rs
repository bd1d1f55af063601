//! The live viewer in a real browser, from the page's first picture to a training that is paused.
//!
//! The trials, `viewer::browser::<what>`, serve a tiny run with the program's own command. They are ignored where no
//! browser is found.

mod checks;
mod live;
mod page;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use anyhow::{Context, Result, anyhow};
use clap::Parser;
use libtest_mimic::Trial;
use mvfusion_cli::args::Command;
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::viewer::address::{BoundSocket, HOST};
use mvfusion_cli::{Cli, command};

use crate::browser::Browser;
use crate::tiny::{SharedRun, mvfusion, text};
use crate::{failed, ignored};

/// A tenth of the default run, in which the branches are told apart, and of which no pictures are written.
const SETTINGS: [&str; 6] = ["--set", "train.scale=0.1", "--set", "eval.strips=0", "--set", "eval.pictures=false"];

/// All trials.
pub fn trials() -> Vec<Trial> {
    vec![
        trial("the_page_shows_a_picture_and_reports_no_fault", checks::loads),
        trial("a_drag_the_wheel_and_keys_change_the_picture", checks::moves),
        trial("the_time_changes_what_moves_and_not_the_background", checks::time),
        trial("each_layer_is_another_picture", checks::layers),
        trial("the_split_view_shows_the_photo", checks::split),
        trial("an_address_restores_the_view", checks::address),
        trial("two_pages_are_served_at_once", checks::two_pages),
        trial("a_page_comes_back_when_the_server_does", checks::restart),
        trial("a_saved_camera_path_is_rendered", checks::path),
        trial("the_page_fits_desktops_and_phones_by_day_and_night", checks::looks),
        trial("a_training_advances_pauses_and_saves", live::advances),
        trial("who_watches_does_not_change_the_result", live::is_the_same),
    ]
}

/// A trial that needs a browser.
fn trial(what: &str, check: impl FnOnce() -> Result<()> + Send + 'static) -> Trial {
    let name = format!("viewer::browser::{what}");
    match Browser::find() {
        Some(_) => Trial::test(name, || check().map_err(failed)),
        None => ignored(name, "no browser was found: set CHROME, or install chromium".to_owned()),
    }
}

/// The run that all trials look at, trained once.
fn run() -> Result<PathBuf> {
    static RUN: SharedRun = SharedRun::new();
    RUN.folder(|run| {
        let line = ["train", "--device", "cpu", "--out", text(run)?].into_iter().chain(SETTINGS);
        mvfusion(&line.collect::<Vec<_>>())
    })
}

/// A server of a run, ended when dropped.
struct Server {
    port: u16,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<()>>>,
}

impl Server {
    /// Serves the run that all trials look at, at any port.
    fn start() -> Result<Self> {
        Self::of(&run()?, 0)
    }

    /// Serves a run at a port.
    fn of(run: &Path, port: u16) -> Result<Self> {
        let run = text(run)?.to_owned();
        // What listens can be connected to before it is served.
        let socket = BoundSocket::bind(HOST, port)?;
        let port = socket.port();
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        let thread = std::thread::spawn(move || {
            let line = ["mvfusion", "view", &run, "--device", "cpu"];
            let Command::View(args) = Cli::try_parse_from(line)?.command else {
                return Err(anyhow!("another command"));
            };
            let mut said = Vec::new();
            command::view_until(&args, socket, Verbosity::SILENT, &mut said, || over.load(Ordering::Relaxed))
        });
        Ok(Self { port, is_over, thread: Some(thread) })
    }

    fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    /// Ends it, and tells how it went.
    fn end(mut self) -> Result<()> {
        self.is_over.store(true, Ordering::Relaxed);
        let thread = self.thread.take().context("a thread")?;
        thread.join().map_err(|_| anyhow!("the server has panicked"))?
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
