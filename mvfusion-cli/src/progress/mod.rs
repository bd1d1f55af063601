//! Notes and progress on stderr: one line that changes on a terminal, a new line every few seconds elsewhere, or JSON.

mod event;
mod pace;

use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use serde_json::{Map, Value};

pub(crate) use event::LogLayer;
pub use event::{Event, Status};
pub use pace::Pace;

/// Time between two lines if stderr is not a terminal.
const PAUSE: Duration = Duration::from_secs(5);

/// Time between two lines of JSON that tell nothing but the step.
const JSON_PAUSE: Duration = Duration::from_secs(1);

/// How a command tells what it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verbosity {
    /// What goes to stderr.
    pub form: Form,
    /// Whether tables show all metrics, also those that repeat others in another form.
    pub all_metrics: bool,
}

/// Whether and how notes and progress are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Notes, progress, errors and results are shown; progress in one line on a terminal, in new lines elsewhere.
    Normal,
    /// The same with progress in new lines.
    Lines,
    /// Notes, errors and results are shown, but no progress.
    Notes,
    /// Everything on stderr is JSON.
    Json,
    /// Only errors and results are shown.
    Silent,
}

impl Verbosity {
    /// Notes, progress and the main metrics.
    pub const NORMAL: Self = Self { form: Form::Normal, all_metrics: false };

    /// Errors and the main metrics.
    pub const SILENT: Self = Self { form: Form::Silent, all_metrics: false };

    /// Whether everything on stderr is JSON.
    pub fn is_json(self) -> bool {
        self.form == Form::Json
    }

    /// Prints a line to stderr.
    pub fn note(self, line: &str) {
        if self.form != Form::Silent {
            self.say(line);
        }
    }

    /// Prints a line to stderr that is needed even if nothing else is shown.
    pub fn say(self, line: &str) {
        match self.form {
            Form::Json => Event::note(line).print(),
            _ => print_line(line),
        }
    }

    /// Tells of a file or folder that was written, for the last line of `--progress json`.
    pub fn wrote(self, name: &'static str, path: &Path) {
        if self.is_json() {
            event::wrote(name, path);
        }
    }
}

/// Prints a line to stderr. If stderr is closed or full, the line is lost: it must never end a command.
pub(crate) fn print_line(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Progress through a known number of steps.
#[derive(Debug)]
pub struct Progress {
    style: Style,
    name: &'static str,
    total: usize,
    done: usize,
    /// The latest message.
    message: String,
}

#[derive(Debug)]
enum Style {
    Bar(ProgressBar),
    Lines {
        last: Instant,
        /// Step of the last line.
        said: usize,
    },
    Json(JsonLines),
    /// Notes only.
    Hidden,
    Silent,
}

/// Progress as lines of JSON.
#[derive(Debug)]
struct JsonLines {
    last: Instant,
    /// Step of the last line.
    said: usize,
    pace: Pace,
    /// What is known of the step that comes next, and the speed up to it.
    recorded: Option<(Map<String, Value>, f64)>,
}

impl Progress {
    /// Progress of `name` through `total` steps.
    pub fn new(name: &'static str, total: usize, verbosity: Verbosity) -> Self {
        let lines = || Style::Lines { last: Instant::now(), said: 0 };
        let style = match verbosity.form {
            Form::Silent => Style::Silent,
            Form::Notes => Style::Hidden,
            Form::Json => Style::Json(JsonLines::new(0)),
            Form::Normal if io::stderr().is_terminal() => Style::Bar(bar(name, total)),
            Form::Normal | Form::Lines => lines(),
        };
        Self { style, name, total, done: 0, message: String::new() }
    }

    /// The same after steps that were done before.
    pub fn after(mut self, done: usize) -> Self {
        self.done = done;
        match &mut self.style {
            Style::Bar(bar) => bar.set_position(done as u64),
            Style::Lines { said, .. } => *said = done,
            Style::Json(lines) => *lines = JsonLines::new(done),
            Style::Hidden | Style::Silent => {}
        }
        self
    }

    /// Counts one more step.
    pub fn advance(&mut self) {
        self.done += 1;
        let line = self.line();
        match &mut self.style {
            Style::Bar(bar) => bar.inc(1),
            Style::Lines { last, said } if last.elapsed() >= PAUSE => {
                (*last, *said) = (Instant::now(), self.done);
                print_line(&line);
            }
            Style::Json(lines) if lines.recorded.is_some() || lines.last.elapsed() >= JSON_PAUSE => {
                lines.print(self.name, self.done, self.total);
            }
            Style::Lines { .. } | Style::Json(_) | Style::Hidden | Style::Silent => {}
        }
    }

    /// Changes the message after the numbers.
    pub fn say(&mut self, message: String) {
        if let Style::Bar(bar) = &self.style {
            bar.set_message(message.clone());
        }
        self.message = message;
    }

    /// For JSON: numbers of the step that is counted next, with the speed. That step is told at once.
    pub fn record(&mut self, numbers: &impl Serialize, steps_per_second: f64) {
        let Style::Json(lines) = &mut self.style else { return };
        // By way of the text: a value would write numbers in single precision with the digits of double precision.
        let numbers = serde_json::to_string(numbers).and_then(|text| serde_json::from_str::<Map<String, Value>>(&text));
        if let Ok(numbers) = numbers {
            lines.recorded = Some((numbers, steps_per_second));
        }
    }

    /// Prints a line above the progress.
    #[cfg_attr(not(feature = "viewer"), allow(dead_code, reason = "only pages ask for what is noted"))]
    pub(crate) fn note(&self, line: &str) {
        match &self.style {
            Style::Bar(bar) => bar.println(line),
            Style::Lines { .. } | Style::Hidden => print_line(line),
            Style::Json(_) => Event::note(line).print(),
            Style::Silent => {}
        }
    }

    /// Ends the display. The last state stays as a line.
    pub fn finish(&mut self) {
        let line = self.line();
        match &mut self.style {
            Style::Bar(bar) => {
                // The bar itself would leave the cursor at its end, and the next output would follow on the same line.
                bar.finish_and_clear();
                print_line(&line);
            }
            Style::Lines { said, .. } if *said < self.done => print_line(&line),
            Style::Json(lines) if lines.said < self.done => lines.print(self.name, self.done, self.total),
            Style::Lines { .. } | Style::Json(_) | Style::Hidden | Style::Silent => {}
        }
    }

    fn line(&self) -> String {
        format!("{} {}/{}  {}", self.name, self.done, self.total, self.message).trim_end().to_owned()
    }
}

impl JsonLines {
    fn new(done: usize) -> Self {
        let mut pace = Pace::default();
        pace.mark(done);
        Self { last: Instant::now(), said: done, pace, recorded: None }
    }

    fn print(&mut self, task: &str, done: usize, total: usize) {
        self.pace.mark(done);
        let (numbers, speed) = self.recorded.take().unwrap_or((Map::new(), self.pace.steps_per_second()));
        let is_known = speed > 0.0 && speed.is_finite();
        let steps_per_second = is_known.then_some(speed);
        let seconds_left = steps_per_second.map(|speed| total.saturating_sub(done) as f64 / speed);
        Event::Progress { task, done, total, steps_per_second, seconds_left, numbers: &numbers }.print();
        (self.last, self.said) = (Instant::now(), done);
    }
}

fn bar(name: &'static str, total: usize) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
    // The template is a constant. If it were invalid, the default bar would be used.
    if let Ok(style) = ProgressStyle::with_template("{prefix} {bar:10} {pos}/{len}  {wide_msg}") {
        bar.set_style(style);
    }
    bar.set_prefix(name);
    bar.enable_steady_tick(Duration::from_millis(500));
    bar
}
