//! The cells of a sweep as processes on this machine.

use std::collections::{BTreeSet, VecDeque};
use std::fs::File;
use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context;
use serde::Serialize;
use serde_json::Map;

use super::estimate::Estimate;
use super::folder::{State, SweepFolder};
use super::index::{Cell, Index};
use super::jobs::share;
use crate::clock::spoken;
use crate::interrupt::is_by_signal;
use crate::progress::{Event, Verbosity};

/// Time between two checks of cells that run in other processes.
const PAUSE: Duration = Duration::from_secs(1);

/// How cells are run on this machine.
#[derive(Clone, Debug)]
pub struct Local<'a> {
    /// The sweep folder.
    pub folder: &'a SweepFolder,
    /// The sweep.
    pub index: &'a Index,
    /// `--device` of each cell.
    pub device: &'a str,
    /// Cells at the same time.
    pub jobs: usize,
    /// Threads, which the cells at work share.
    pub threads: usize,
    /// Amount of output.
    pub verbosity: Verbosity,
}

/// The state that the workers share.
struct Progress<'a> {
    queue: VecDeque<&'a Cell>,
    /// Cells that run here.
    running: usize,
    /// Cells that run in other processes.
    awaited: BTreeSet<String>,
    estimate: Estimate,
    done: usize,
    failed: usize,
}

/// The outcome of a cell's turn.
struct End {
    state: State,
    /// Running time; absent if it did not need to run.
    took: Option<Duration>,
}

/// A cell that ended, for `--progress json`.
#[derive(Serialize)]
struct EndedCell<'a> {
    id: &'a str,
    name: String,
    state: &'static str,
    /// Running time; absent if it did not need to run.
    #[serde(skip_serializing_if = "Option::is_none")]
    seconds: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    failure: Option<&'a str>,
}

impl Local<'_> {
    /// Runs cells. Returns the number of failed cells.
    ///
    /// # Errors
    /// If the folder can no longer be used, or the program cannot be started.
    pub fn run(&self, cells: &[&Cell], estimate: Estimate) -> anyhow::Result<usize> {
        let progress = Mutex::new(Progress {
            queue: cells.iter().copied().collect(),
            running: 0,
            awaited: BTreeSet::new(),
            estimate,
            done: 0,
            failed: 0,
        });
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..self.jobs).map(|_| scope.spawn(|| self.work(&progress, cells.len()))).collect();
            // Wait for every worker, even if others failed.
            let ended: Vec<_> = workers.into_iter().map(|worker| worker.join()).collect();
            ended.into_iter().try_for_each(|end| end.unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        })?;
        Ok(held(&progress).failed)
    }

    /// Takes cells from the queue until it is empty.
    fn work(&self, progress: &Mutex<Progress<'_>>, count: usize) -> anyhow::Result<()> {
        // A separate closure, so that the lock is not held while a cell runs.
        let next = || {
            let mut progress = held(progress);
            let cell = progress.queue.pop_front()?;
            progress.running += 1;
            Some((cell, progress.running + progress.queue.len()))
        };
        while let Some((cell, left)) = next() {
            // The last cells have fewer to share with. A result does not depend on the number of threads.
            let end = self.one(cell, self.share(left));
            held(progress).running -= 1;
            let end = end?;
            if end.state == State::Running {
                if held(progress).awaited.insert(cell.id.clone()) {
                    let name = cell.name(&self.index.axes);
                    self.verbosity.note(&format!("{} {name}: waiting for another process that runs it", cell.id));
                }
                held(progress).queue.push_back(cell);
                std::thread::sleep(PAUSE);
                continue;
            }
            let mut progress = held(progress);
            progress.done += 1;
            match end.state {
                State::Finished => {
                    // This process may have done the last steps alone, or only the evaluation.
                    if let Some(results) = self.folder.results(&cell.id).filter(|_| end.took.is_some()) {
                        progress.estimate.add_finished(cell, &results);
                    }
                }
                _ => progress.failed += 1,
            }
            self.tell(&progress, cell, &end, count);
        }
        Ok(())
    }

    /// Threads of a cell if so many are at work or wait.
    pub fn share(&self, left: usize) -> usize {
        share(self.threads, self.jobs.min(left))
    }

    /// Runs a cell, unless it is finished or runs in another process.
    fn one(&self, cell: &Cell, threads: usize) -> anyhow::Result<End> {
        let look = || self.folder.state(&cell.id, &self.index.wanted);
        let state = look()?;
        if matches!(state, State::Finished | State::Running) {
            return Ok(End { state, took: None });
        }
        let started = Instant::now();
        let status = self.process(cell, threads)?;
        let took = Some(started.elapsed());
        match look()? {
            // It has not failed: the next sweep continues it from its checkpoint.
            State::ToDo | State::Interrupted if status.code().is_some_and(is_by_signal) => {
                Ok(End { state: State::Interrupted, took })
            }
            // The process was killed, or could not record why it failed.
            State::ToDo | State::Interrupted => {
                let words = format!("{status}; see the end of {}", self.folder.log(&cell.id).display());
                self.folder.note_failure(&cell.id, &words)?;
                Ok(End { state: State::Failed(words), took })
            }
            state => Ok(End { state, took }),
        }
    }

    fn process(&self, cell: &Cell, threads: usize) -> anyhow::Result<ExitStatus> {
        let path = self.folder.log(&cell.id);
        // Append, because another process may still be running the cell and writing to this file.
        let log = File::options().create(true).append(true).open(&path);
        let log = log.with_context(|| format!("cannot write {}", path.display()))?;
        own_program()?
            .args(["sweep", "run-cell", "--cell", &cell.id, "--device", self.device])
            .args(["--threads", &threads.to_string(), "--out"])
            .arg(self.folder.path())
            .stdin(Stdio::null())
            .stdout(log.try_clone()?)
            .stderr(log)
            .status()
            .context("cannot start the program for a cell")
    }

    /// Tells how a cell ended, and how far the sweep is.
    fn tell(&self, progress: &Progress<'_>, cell: &Cell, end: &End, count: usize) {
        if !self.verbosity.is_json() {
            return self.verbosity.note(&self.line(progress, cell, end, count));
        }
        let ended = EndedCell {
            id: &cell.id,
            name: cell.name(&self.index.axes),
            state: end.state.word(),
            seconds: end.took.map(|took| took.as_secs_f64()),
            failure: match &end.state {
                State::Failed(words) => Some(words),
                _ => None,
            },
        };
        let numbers = serde_json::to_value(ended).map(|ended| Map::from_iter([("cell".to_owned(), ended)]));
        Event::Progress {
            task: "sweep",
            done: progress.done,
            total: count,
            steps_per_second: None,
            seconds_left: self.seconds_left(progress),
            numbers: &numbers.unwrap_or_default(),
        }
        .print();
    }

    /// Seconds that the cells in the queue take; `None` before one has ended, and if the queue is empty.
    fn seconds_left(&self, progress: &Progress<'_>) -> Option<f64> {
        let seconds = progress.estimate.seconds(progress.queue.iter().copied(), self.jobs);
        seconds.filter(|_| !progress.queue.is_empty())
    }

    fn line(&self, progress: &Progress<'_>, cell: &Cell, end: &End, count: usize) -> String {
        let left = self.seconds_left(progress);
        let left = left.map_or(String::new(), |seconds| format!("; about {} left", spoken(seconds)));
        let what = match (&end.state, end.took) {
            (State::Failed(words), _) => format!("failed: {words}"),
            (state, Some(took)) => format!("{} after {}", state.word(), spoken(took.as_secs_f64())),
            (state, None) => format!("{} by another process", state.word()),
        };
        format!("[{}/{count}] {} {}: {what}{left}", progress.done, cell.id, cell.name(&self.index.axes))
    }
}

/// The program file as it was when the sweep started, even if the program has been rebuilt since.
pub(super) fn own_program() -> anyhow::Result<Command> {
    // On Linux, this path always refers to the running executable.
    let this = if cfg!(target_os = "linux") { PathBuf::from("/proc/self/exe") } else { std::env::current_exe()? };
    Ok(Command::new(this))
}

/// Takes the lock. If a worker panicked while holding it, the sweep ends anyway.
fn held<'a, 'b>(progress: &'a Mutex<Progress<'b>>) -> MutexGuard<'a, Progress<'b>> {
    progress.lock().unwrap_or_else(PoisonError::into_inner)
}
