//! The viewer of a training.

use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail, ensure};
use clap::Parser;
use mvfusion_cli::args::Command;
use mvfusion_cli::interrupt::{Interrupted, Signals};
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::viewer::address::{BoundSocket, HOST};
use mvfusion_cli::{Cli, command};
use mvfusion_tests::ViewerClient;

use super::Server;
use super::page::Page;
use crate::tiny::training;

/// The training outlasts the trial, which ends it, however slow the browser is. A checkpoint is kept that was written
/// when all stages were passed.
const SETTINGS: [&str; 6] = [
    "--set",
    "train.stages={geometry=40, deformation=40, refinement=1000000}",
    "--set",
    "train.checkpoint_interval=150",
    "--set",
    "train.keep_checkpoints=1000",
];
const KEPT: &str = "checkpoints/step_150.safetensors";

/// How long anything may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// A training of the tiny model in a thread, interrupted when dropped.
struct Training {
    signals: Signals,
    thread: Option<JoinHandle<Result<()>>>,
}

impl Training {
    fn start(run: &Path, viewer: Option<BoundSocket>, more: &[&str]) -> Result<Self> {
        let settings = [&SETTINGS[..], more].concat();
        let line = training(run, &settings)?;
        let Command::Train(args) = Cli::try_parse_from(["mvfusion"].iter().chain(&line))?.command else {
            bail!("another command")
        };
        let signals = Signals::default();
        let given = signals.clone();
        let thread = std::thread::spawn(move || {
            command::train_in_thread(&args, given, viewer, Verbosity::SILENT, &mut Vec::new())
        });
        Ok(Self { signals, thread: Some(thread) })
    }

    /// One that is served, and pauses after a step.
    fn paused(run: &Path, more: &[&str]) -> Result<(Self, u16)> {
        let viewer = BoundSocket::bind(HOST, 0)?;
        let port = viewer.port();
        let training = Self::start(run, Some(viewer), more)?;
        let mut page = ViewerClient::open(port)?;
        page.send("{\"type\":\"pause\"}")?;
        // It is told that the training pauses before it leaves.
        page.wait_for(|status| status["activity"] == "pauses")?;
        Ok((training, port))
    }

    /// Interrupts it, and checks that nothing else has ended it.
    fn end(mut self) -> Result<()> {
        self.signals.raise();
        let thread = self.thread.take().context("a thread")?;
        match thread.join().map_err(|_| anyhow!("the training has panicked"))? {
            Err(error) if error.is::<Interrupted>() => Ok(()),
            other => bail!("the training ended by itself: {other:?}"),
        }
    }
}

impl Drop for Training {
    fn drop(&mut self) {
        self.signals.raise();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn address(port: u16) -> String {
    format!("http://{HOST}:{port}/")
}

/// Step and picture follow the training, which pauses, saves a checkpoint, and goes on.
pub fn advances() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let run = folder.path().join("run");
    let (training, port) = Training::paused(&run, &[])?;
    let mut page = Page::open(&address(port))?;
    page.wait("document.body.dataset.activity === 'pauses'")?;
    page.click("pause")?;
    page.wait("Number(document.body.dataset.frames) > 2 && viewer.curves.points.length > 3")?;
    let step = |page: &mut Page| -> Result<u64> {
        let step = page.ask("Number(document.body.dataset.step)")?;
        step.as_f64().map(|step| step as u64).context("a step")
    };
    let first = step(&mut page)?;
    page.wait(&format!("Number(document.body.dataset.step) > {first} + 10"))?;
    page.click("pause")?;
    page.wait("document.body.dataset.activity === 'pauses' && document.body.dataset.sharp === 'true'")?;
    let paused = page.ask("Number(document.body.dataset.trained)")?;
    // What is on its way arrives, and nothing changes any more; the picture can be looked at.
    std::thread::sleep(Duration::from_millis(600));
    page.drag([80.0, 10.0])?;
    page.picture()?;
    ensure!(page.ask("Number(document.body.dataset.trained)")? == paused, "the training does not pause");
    page.click("checkpoint")?;
    page.wait("!document.getElementById('saved').hidden")?;
    let paused = paused.as_f64().context("a step")? as u64;
    let file = run.join("checkpoints").join(format!("step_{paused}.safetensors"));
    ensure!(file.is_file(), "{} is not there", file.display());
    page.reports_nothing(&address(port))?;
    page.click("pause")?;
    page.wait(&format!(
        "document.body.dataset.activity !== 'pauses' && Number(document.body.dataset.trained) > {paused}"
    ))?;
    // What is served at the same place next is another thing, and the page notices.
    training.end()?;
    let _server = Server::of(&run, port)?;
    page.wait("globalThis.viewer?.scene.training === false && document.body.dataset.link === 'open'")?;
    ensure!(page.ask("document.getElementById('training').hidden")? == true, "the page still shows a training");
    page.picture().map(drop)
}

/// A training that was watched, paused and saved, and that wrote event files, has the same state, to the bit, as one
/// that nobody watched.
pub fn is_the_same() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let [watched, alone] = ["watched", "alone"].map(|name| folder.path().join(name));
    let (training, port) = Training::paused(&watched, &["--set", "train.tensorboard=true"])?;
    let mut page = Page::open(&address(port))?;
    for layer in ["static", "mask", "depth", "composed"] {
        page.set("layer", layer)?;
        page.wait(&format!("viewer.facts?.layer === '{layer}'"))?;
        page.picture()?;
    }
    page.click("pause")?;
    page.wait("document.body.dataset.activity === 'trains' && Number(document.body.dataset.step) > 20")?;
    page.click("pause")?;
    page.wait("document.body.dataset.activity === 'pauses'")?;
    page.click("checkpoint")?;
    page.wait("!document.getElementById('saved').hidden")?;
    page.click("pause")?;
    page.wait("Number(document.body.dataset.trained) > 150")?;
    training.end()?;
    let training = Training::start(&alone, None, &[])?;
    let until = Instant::now() + TIMEOUT;
    while !alone.join(KEPT).is_file() {
        ensure!(Instant::now() < until, "the training alone writes no checkpoint");
        std::thread::sleep(Duration::from_millis(20));
    }
    training.end()?;
    let [watched, alone] = [watched, alone].map(|run| std::fs::read(run.join(KEPT)));
    ensure!(watched? == alone?, "the checkpoints differ");
    Ok(())
}
