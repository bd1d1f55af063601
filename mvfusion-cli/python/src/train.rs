//! A training, observed from Python.

use std::ops::ControlFlow;
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use mvfusion_cli::args::{ConfigSourceArgs, TrainArgs};
use mvfusion_cli::command::{self, Observer};
use mvfusion_cli::interrupt::{Interrupted, Signals};
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::run::MetricsLine;
use mvfusion_cli::threads;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::raised;
use crate::values::table;

/// How often Python is asked for signals, such as Ctrl-C.
const PAUSE: Duration = Duration::from_millis(50);

/// What is trained, and how.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Order {
    /// Nested dicts of keys.
    config: Option<Py<PyDict>>,
    config_file: Option<PathBuf>,
    preset: Option<String>,
    data: Option<PathBuf>,
    out: Option<PathBuf>,
    device: String,
    seed: Option<u64>,
    threads: Option<std::num::NonZeroUsize>,
    lpips_weights: Option<PathBuf>,
    resume: Option<PathBuf>,
    init_from: Option<PathBuf>,
    force: bool,
    verbose: bool,
}

impl Order {
    fn args(self, py: Python<'_>) -> PyResult<TrainArgs> {
        let table = self.config.map(|dict| table(dict.bind(py))).transpose()?;
        let mut args = TrainArgs {
            data: self.data,
            sources: ConfigSourceArgs {
                preset: self.preset,
                config: self.config_file,
                table,
                seed: self.seed,
                ..ConfigSourceArgs::default()
            },
            lpips_weights: self.lpips_weights,
            out: self.out,
            force: self.force,
            init_from: self.init_from,
            resume: self.resume,
            ..TrainArgs::default()
        };
        (args.compute.device, args.compute.threads) = (self.device, self.threads);
        Ok(args)
    }
}

/// Trains in a thread of its own, and returns the run folder, also if the callback ended the training. The calling thread
/// runs the callback and watches for signals.
#[pyfunction]
pub fn train(py: Python<'_>, order: Order, callback: Option<Bound<'_, PyAny>>) -> PyResult<PathBuf> {
    let verbosity = if order.verbose { Verbosity::NORMAL } else { Verbosity::SILENT };
    let args = order.args(py)?;
    let signals = Signals::default();
    let (line, lines) = mpsc::channel::<MetricsLine>();
    let (verdict, verdicts) = mpsc::channel::<ControlFlow<()>>();
    let training = {
        let (signals, has_callback) = (signals.clone(), callback.is_some());
        thread::Builder::new().name("mvfusion-train".to_owned()).spawn(move || {
            let _pool = threads::start_own(threads::count(args.compute.threads))?;
            // Kept to the end of the training, which the calling thread learns by its absence.
            let kept = line.clone();
            let observer = has_callback.then(|| -> Observer {
                Box::new(move |logged| match line.send(logged.clone()) {
                    Ok(()) => verdicts.recv().unwrap_or(ControlFlow::Break(())),
                    Err(_) => ControlFlow::Break(()),
                })
            });
            let trained = command::train_observed(&args, signals, observer, verbosity);
            drop(kept);
            trained
        })?
    };
    let raised_here = watch(py, lines, &verdict, &signals, callback.as_ref());
    drop(verdict);
    let trained = py.detach(|| training.join()).unwrap_or_else(|panic| resume_unwind(panic));
    concluded(py, trained, raised_here)
}

/// Waits for the end of the training. Returns what was raised meanwhile.
fn watch(
    py: Python<'_>,
    mut lines: mpsc::Receiver<MetricsLine>,
    verdict: &mpsc::Sender<ControlFlow<()>>,
    signals: &Signals,
    callback: Option<&Bound<'_, PyAny>>,
) -> Option<PyErr> {
    let mut raised_here = None;
    loop {
        let received;
        (lines, received) = py.detach(move || {
            let received = lines.recv_timeout(PAUSE);
            (lines, received)
        });
        let logged = match received {
            Ok(logged) => Some(logged),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return raised_here,
        };
        if let Err(error) = py.check_signals() {
            signals.raise();
            raised_here.get_or_insert(error);
        }
        let Some(logged) = logged else { continue };
        let goes_on = match (callback, &raised_here) {
            (Some(callback), None) => told(py, callback, &logged).unwrap_or_else(|error| {
                raised_here = Some(error);
                false
            }),
            _ => raised_here.is_none(),
        };
        // Whoever no longer waits for it has ended.
        let _ = verdict.send(if goes_on { ControlFlow::Continue(()) } else { ControlFlow::Break(()) });
    }
}

/// Tells the callback of a step. Whether the training goes on: it does unless the answer is `False`.
fn told(py: Python<'_>, callback: &Bound<'_, PyAny>, logged: &MetricsLine) -> PyResult<bool> {
    let text = serde_json::to_string(logged).map_err(|error| raised(&error.into()))?;
    let line = py.import("json")?.call_method1("loads", (text,))?;
    line.call_method1("setdefault", ("psnr", py.None()))?;
    let answer = callback.call1((line,))?;
    Ok(answer.is_none() || !matches!(answer.extract::<bool>(), Ok(false)))
}

fn concluded(py: Python<'_>, trained: anyhow::Result<PathBuf>, raised_here: Option<PyErr>) -> PyResult<PathBuf> {
    let (error, raised_here) = match (trained, raised_here) {
        (Ok(folder), None) => return Ok(folder),
        (Ok(_), Some(raised_here)) => return Err(raised_here),
        (Err(error), raised_here) => (error, raised_here),
    };
    match (error.downcast_ref::<Interrupted>(), raised_here) {
        (Some(interrupted), None) => Ok(interrupted.run.clone()),
        (Some(interrupted), Some(raised_here)) => {
            // Python 3.10 has no notes.
            let _ = raised_here.value(py).call_method1("add_note", (interrupted.to_string(),));
            Err(raised_here)
        }
        (None, raised_here) => {
            let error = raised(&error);
            error.set_cause(py, raised_here);
            Err(error)
        }
    }
}
