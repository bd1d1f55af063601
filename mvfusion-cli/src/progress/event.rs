//! The lines of `--progress json`: one JSON object a line on stderr, and nothing else there (docs/formats.md).

use std::collections::BTreeMap;
use std::fmt;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::Serialize;
use serde_json::{Map, Value};
use tracing::field::{Field, Visit};
use tracing::{Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

/// A line. Its field `event` has the variant's name.
#[derive(Debug, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event<'a> {
    /// What a command does or has decided.
    Note {
        /// The word before the colon: `device`, `scene`, `run`, `note` and others.
        #[serde(skip_serializing_if = "Option::is_none")]
        topic: Option<&'a str>,
        /// The rest.
        text: &'a str,
    },
    /// How far a task is.
    Progress {
        /// Its name: `training`, `evaluation`, `rendering` and others.
        task: &'a str,
        /// Steps done.
        done: usize,
        /// Steps of the task.
        total: usize,
        /// Absent before it is known.
        #[serde(skip_serializing_if = "Option::is_none")]
        steps_per_second: Option<f64>,
        /// Absent before it is known.
        #[serde(skip_serializing_if = "Option::is_none")]
        seconds_left: Option<f64>,
        /// What else is known, by the task.
        #[serde(flatten)]
        numbers: &'a Map<String, Value>,
    },
    /// Something that the user should look at.
    Warning {
        /// In words.
        text: &'a str,
    },
    /// A line of the log, with `-v`.
    Log {
        /// `info`, `debug` or `trace`.
        level: &'a str,
        /// In words.
        text: &'a str,
    },
    /// The last line.
    End {
        /// How the command ended.
        status: Status,
        /// The exit code of the process.
        exit_code: u8,
        /// Why the command failed, or what becomes of an interrupted one.
        #[serde(skip_serializing_if = "Option::is_none")]
        message: Option<&'a str>,
        /// Files and folders that were written.
        paths: BTreeMap<&'static str, PathBuf>,
    },
}

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// It has done what it was asked for.
    Ok,
    /// It failed.
    Failed,
    /// A signal ended it in order: a training can be continued, and nothing is left of what others were making.
    Interrupted,
}

/// Where the command has written, for its last line. The process has one stderr, so it has one such list.
static WRITTEN: Mutex<BTreeMap<&'static str, PathBuf>> = Mutex::new(BTreeMap::new());

impl<'a> Event<'a> {
    /// A note as it is said to people: `device: flex on the CPU`.
    pub fn note(line: &'a str) -> Self {
        let is_word = |topic: &str| !topic.is_empty() && topic.chars().all(|c| c.is_ascii_lowercase());
        match line.split_once(": ").filter(|(topic, _)| is_word(topic)) {
            Some((topic, text)) => Self::Note { topic: Some(topic), text: text.trim() },
            None => Self::Note { topic: None, text: line.trim() },
        }
    }

    /// The end of a command that wrote what [`Verbosity::wrote`](super::Verbosity::wrote) was told.
    pub fn end(status: Status, exit_code: u8, message: Option<&'a str>) -> Self {
        let paths = std::mem::take(&mut *WRITTEN.lock().unwrap_or_else(PoisonError::into_inner));
        Self::End { status, exit_code, message, paths }
    }

    /// Prints it at once, so that lines of several threads do not mix. If stderr is closed or full, the line is lost.
    pub fn print(&self) {
        let Ok(mut line) = serde_json::to_string(self) else { return };
        line.push('\n');
        let _ = io::stderr().lock().write_all(line.as_bytes());
    }
}

/// Remembers a file or folder for the last line.
pub fn wrote(name: &'static str, path: &Path) {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    WRITTEN.lock().unwrap_or_else(PoisonError::into_inner).insert(name, path);
}

/// Writes logs as such lines.
#[derive(Debug)]
pub struct LogLayer;

impl<S: Subscriber> Layer<S> for LogLayer {
    fn on_event(&self, event: &tracing::Event<'_>, _: Context<'_, S>) {
        let mut text = Text::default();
        event.record(&mut text);
        let text = format!("{}{}", text.message, text.fields);
        match *event.metadata().level() {
            Level::ERROR | Level::WARN => Event::Warning { text: &text }.print(),
            level => Event::Log { level: &level.as_str().to_ascii_lowercase(), text: &text }.print(),
        }
    }
}

/// The message of a line of the log, and its other fields.
#[derive(Default)]
struct Text {
    message: String,
    fields: String,
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        match field.name() {
            "message" => self.message = format!("{value:?}"),
            name => self.fields += &format!(" {name}={value:?}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(event: &Event<'_>) -> String {
        serde_json::to_string(event).expect("JSON")
    }

    #[test]
    fn a_note_has_the_word_before_its_colon_as_topic() {
        let said = |text| line(&Event::note(text));
        assert_eq!(said("scene:  a: b"), r#"{"event":"note","topic":"scene","text":"a: b"}"#);
        assert_eq!(said("[1/3] cell: done"), r#"{"event":"note","text":"[1/3] cell: done"}"#);
        assert_eq!(said("decoding every image"), r#"{"event":"note","text":"decoding every image"}"#);
    }

    #[test]
    fn numbers_stand_beside_the_progress() {
        let numbers = Map::from_iter([("loss".to_owned(), Value::from(0.5))]);
        let progress = Event::Progress {
            task: "training",
            done: 3,
            total: 9,
            steps_per_second: None,
            seconds_left: None,
            numbers: &numbers,
        };
        assert_eq!(line(&progress), r#"{"event":"progress","task":"training","done":3,"total":9,"loss":0.5}"#);
    }

    #[test]
    fn the_end_tells_where_the_command_has_written() {
        wrote("run", Path::new("/runs/a"));
        let end = Event::end(Status::Interrupted, 130, Some("saved"));
        assert_eq!(
            line(&end),
            r#"{"event":"end","status":"interrupted","exit_code":130,"message":"saved","paths":{"run":"/runs/a"}}"#
        );
        assert!(matches!(Event::end(Status::Ok, 0, None), Event::End { paths, .. } if paths.is_empty()));
    }
}
