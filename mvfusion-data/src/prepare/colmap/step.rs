//! A step of COLMAP: its process, its log and its progress.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use super::super::error::PrepareError;
use super::super::event::{Event, Listener, Tell};

/// Number of lines of the log that an error repeats.
const LAST_WORDS: usize = 2;

/// The longest silence of COLMAP after which the listener is asked whether it is to go on.
const PAUSE: Duration = Duration::from_millis(100);

/// The log of all steps.
#[derive(Debug)]
pub(in super::super) struct Log {
    file: File,
    path: PathBuf,
    /// Where it will lie when an error is read.
    shown: PathBuf,
}

impl Log {
    /// A log at `path`, which errors call `shown`.
    pub(in super::super) fn create(path: &Path, shown: &Path) -> Result<Self, PrepareError> {
        let file = File::create(path).map_err(|error| PrepareError::unwritable(path, error))?;
        Ok(Self { file, path: path.to_owned(), shown: shown.to_owned() })
    }

    /// The path that errors name.
    pub(in super::super) fn shown(&self) -> &Path {
        &self.shown
    }

    fn line(&mut self, line: &str) -> Result<(), PrepareError> {
        writeln!(self.file, "{line}").map_err(|error| PrepareError::unwritable(&self.path, error))
    }
}

/// A process that is killed when it is dropped before its end.
struct Guard(Child);

impl Drop for Guard {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs a step to its end. `counts` tells whether a line of its output ends one of `total` parts.
///
/// # Errors
/// [`PrepareError::Step`] if it fails. If the listener ends it, COLMAP is killed.
pub(super) fn run(
    (name, command): (&'static str, &mut Command),
    (title, total): (&'static str, usize),
    counts: fn(&str) -> bool,
    log: &mut Log,
    listen: &mut Listener<'_>,
) -> Result<(), PrepareError> {
    log.line(&format!("$ {command:?}"))?;
    listen.tell(Event::Begins { what: title, total })?;
    let spawned = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let failed = |status: String, said: String| PrepareError::Step {
        step: name,
        status,
        said,
        log: log.shown().to_owned(),
        advice: advice(name),
    };
    let mut child = Guard(spawned.map_err(|error| failed(error.to_string(), String::new()))?);
    let (sender, lines) = channel();
    let readers = [pass_on(child.0.stdout.take(), sender.clone()), pass_on(child.0.stderr.take(), sender)];
    let (mut last, mut done) = (Vec::new(), 0);
    loop {
        listen.tell(Event::Continues)?;
        let line = match lines.recv_timeout(PAUSE) {
            Ok(line) => line,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => break,
        };
        log.line(&line)?;
        // An image may be tried more than once.
        if counts(&line) && done < total {
            done += 1;
            listen.tell(Event::Advances)?;
        }
        if !line.trim().is_empty() {
            last.push(line);
        }
    }
    for reader in readers.into_iter().flatten() {
        let _ = reader.join();
    }
    let status = child.0.wait().map_err(|error| PrepareError::unwritable(log.shown(), error))?;
    listen.tell(Event::Ends)?;
    if status.success() {
        return Ok(());
    }
    let said = last[last.len().saturating_sub(LAST_WORDS)..].join(" / ");
    let said = if said.is_empty() { said } else { format!(": {}", said.trim().trim_end_matches('.')) };
    Err(PrepareError::Step {
        step: name,
        status: ended(status),
        said,
        log: log.shown().to_owned(),
        advice: advice(name),
    })
}

/// Sends the lines of a stream.
fn pass_on(stream: Option<impl Read + Send + 'static>, lines: Sender<String>) -> Option<thread::JoinHandle<()>> {
    let stream = stream?;
    Some(thread::spawn(move || {
        for line in BufReader::new(stream).split(b'\n').map_while(Result::ok) {
            if lines.send(String::from_utf8_lossy(&line).trim_end().to_owned()).is_err() {
                return;
            }
        }
    }))
}

fn ended(status: ExitStatus) -> String {
    match status.code() {
        Some(code) => format!("exit code {code}"),
        None => "ended by a signal; the memory may not have sufficed".into(),
    }
}

fn advice(step: &str) -> &'static str {
    match step {
        "feature_extractor" => "Check that the photos open in other programs; if a GPU is at fault, add --gpu off",
        _ => "If a GPU is at fault, add --gpu off; if memory is, take fewer or smaller images",
    }
}
