//! The viewer of a training.

use std::net::TcpStream;
use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use serde_json::Value;
use tungstenite::Message;

use super::free_port;
use super::page::Page;
use crate::tiny::train;

/// Few steps: the training pauses until a browser is there.
const STAGES: &str = "train.stages={geometry=100, deformation=100, refinement=100}";

/// How long anything may take.
const PATIENCE: Duration = Duration::from_secs(60);

/// A training of the tiny model that is served.
struct Training {
    port: u16,
    thread: JoinHandle<Result<String>>,
}

impl Training {
    fn start(run: &Path, stages: &'static str) -> Result<Self> {
        let (run, port) = (run.to_owned(), free_port()?);
        let thread = std::thread::spawn(move || train(&run, &["--set", stages, &format!("--view={port}")]));
        pause(port)?;
        Ok(Self { port, thread })
    }

    fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    fn end(self) -> Result<String> {
        self.thread.join().map_err(|_| anyhow!("the training has panicked"))?
    }
}

/// Orders a pause as soon as the training is served.
fn pause(port: u16) -> Result<()> {
    let until = Instant::now() + PATIENCE;
    let stream = loop {
        match TcpStream::connect(("127.0.0.1", port)) {
            Ok(stream) => break stream,
            Err(error) => ensure!(Instant::now() < until, "the training is not served: {error}"),
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let opened = tungstenite::client(format!("ws://127.0.0.1:{port}/socket"), stream);
    let (mut socket, _) = opened.map_err(|error| anyhow!("{error}"))?;
    socket.send(Message::text("{\"type\":\"pause\"}"))?;
    // It is told that the training pauses before it leaves.
    loop {
        if let Message::Text(text) = socket.read()?
            && text.contains("\"pauses\"")
        {
            return Ok(());
        }
        ensure!(Instant::now() < until, "the training does not pause");
    }
}

/// Step and picture follow the training, which pauses, saves a checkpoint, and goes on.
pub fn advances() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let run = folder.path().join("run");
    let training = Training::start(&run, STAGES)?;
    let mut page = Page::open(&training.address())?;
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
    page.reports_nothing(&training.address())?;
    page.click("pause")?;
    page.wait(&format!(
        "document.body.dataset.activity !== 'pauses' && Number(document.body.dataset.trained) > {paused}"
    ))?;
    drop(page);
    training.end().map(drop)
}

/// The parameters of a training that was watched, paused and saved are those of one that nobody watched.
pub fn is_the_same() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let [watched, alone] = ["watched", "alone"].map(|name| folder.path().join(name));
    let training = Training::start(&watched, STAGES)?;
    let mut page = Page::open(&training.address())?;
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
    page.wait("document.body.dataset.activity !== 'pauses'")?;
    training.end()?;
    train(&alone, &["--set", STAGES])?;
    let hash = |run: &Path| -> Result<Value> {
        let results: Value = serde_json::from_slice(&std::fs::read(run.join("results.json"))?)?;
        Ok(results["params_sha256"].clone())
    };
    let (watched, alone) = (hash(&watched)?, hash(&alone)?);
    ensure!(watched.is_string() && watched == alone, "watched {watched}, alone {alone}");
    Ok(())
}
