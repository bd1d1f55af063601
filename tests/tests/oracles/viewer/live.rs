//! The viewer of a training.

use std::path::Path;
use std::thread::JoinHandle;

use anyhow::{Context, Result, anyhow, ensure};
use serde_json::Value;

use super::free_port;
use super::page::Page;
use crate::tiny::train;

/// Enough steps to be looked at.
const STAGES: &str = "train.stages={geometry=1200, deformation=1200, refinement=1200}";

/// A training of the tiny model that is served.
struct Training {
    port: u16,
    thread: JoinHandle<Result<String>>,
}

impl Training {
    fn start(run: &Path, stages: &'static str) -> Result<Self> {
        let (run, port) = (run.to_owned(), free_port()?);
        let thread = std::thread::spawn(move || train(&run, &["--set", stages, &format!("--view={port}")]));
        Ok(Self { port, thread })
    }

    fn address(&self) -> String {
        format!("http://127.0.0.1:{}/", self.port)
    }

    fn end(self) -> Result<String> {
        self.thread.join().map_err(|_| anyhow!("the training has panicked"))?
    }
}

/// Step and picture follow the training, which pauses, saves a checkpoint, and goes on.
pub fn advances() -> Result<()> {
    let folder = tempfile::tempdir()?;
    let run = folder.path().join("run");
    let training = Training::start(&run, STAGES)?;
    let mut page = Page::open(&training.address())?;
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
    std::thread::sleep(std::time::Duration::from_millis(600));
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
        "document.body.dataset.activity === 'trains' && Number(document.body.dataset.step) > {paused}"
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
    }
    page.click("pause")?;
    page.wait("document.body.dataset.activity === 'pauses'")?;
    page.picture()?;
    page.click("checkpoint")?;
    page.wait("!document.getElementById('saved').hidden")?;
    page.click("pause")?;
    page.wait("document.body.dataset.activity === 'trains'")?;
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
