//! Progress output: one line that changes on a terminal, or a new line every few seconds elsewhere.

use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::clock::spoken;

/// Time between two lines if stderr is not a terminal.
const PAUSE: Duration = Duration::from_secs(5);

/// Whether notes and progress are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verbosity {
    /// Notes, progress, errors and results are shown.
    Normal,
    /// Results are shown with what repeats other results in another form.
    Verbose,
    /// Only errors and results are shown.
    Silent,
}

impl Verbosity {
    /// Prints a line to stderr.
    pub fn note(self, line: &str) {
        if self != Self::Silent {
            print_line(line);
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
    Silent,
}

impl Progress {
    /// Progress of `name` through `total` steps.
    pub fn new(name: &'static str, total: usize, verbosity: Verbosity) -> Self {
        let style = match verbosity {
            Verbosity::Silent => Style::Silent,
            Verbosity::Normal | Verbosity::Verbose if io::stderr().is_terminal() => Style::Bar(bar(name, total)),
            Verbosity::Normal | Verbosity::Verbose => Style::Lines { last: Instant::now(), said: 0 },
        };
        Self { style, name, total, done: 0, message: String::new() }
    }

    /// The same after steps that were done before.
    pub fn after(mut self, done: usize) -> Self {
        self.done = done;
        match &mut self.style {
            Style::Bar(bar) => bar.set_position(done as u64),
            Style::Lines { said, .. } => *said = done,
            Style::Silent => {}
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
            Style::Lines { .. } | Style::Silent => {}
        }
    }

    /// Changes the message after the numbers.
    pub fn say(&mut self, message: String) {
        if let Style::Bar(bar) = &self.style {
            bar.set_message(message.clone());
        }
        self.message = message;
    }

    /// Prints a line above the progress.
    #[cfg_attr(not(feature = "viewer"), allow(dead_code, reason = "only pages ask for what is noted"))]
    pub(crate) fn note(&self, line: &str) {
        match &self.style {
            Style::Bar(bar) => bar.println(line),
            Style::Lines { .. } => print_line(line),
            Style::Silent => {}
        }
    }

    /// Ends the display. The last state stays as a line.
    pub fn finish(&self) {
        match &self.style {
            Style::Bar(bar) => {
                // The bar itself would leave the cursor at its end, and the next output would follow on the same line.
                bar.finish_and_clear();
                print_line(&self.line());
            }
            Style::Lines { said, .. } if *said < self.done => print_line(&self.line()),
            Style::Lines { .. } | Style::Silent => {}
        }
    }

    fn line(&self) -> String {
        format!("{} {}/{}  {}", self.name, self.done, self.total, self.message).trim_end().to_owned()
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

/// The speed of the steps, and an estimate of the remaining time.
#[derive(Clone, Debug)]
pub struct Pace {
    started: Instant,
    marked: (Instant, usize),
    steps_per_second: f64,
}

impl Default for Pace {
    fn default() -> Self {
        let now = Instant::now();
        Self { started: now, marked: (now, 0), steps_per_second: 0.0 }
    }
}

impl Pace {
    /// Measures the speed since the last mark, at `done` steps.
    pub fn mark(&mut self, done: usize) {
        let now = Instant::now();
        let seconds = now.duration_since(self.marked.0).as_secs_f64();
        if seconds > 0.0 && done > self.marked.1 {
            self.steps_per_second = (done - self.marked.1) as f64 / seconds;
        }
        self.marked = (now, done);
    }

    /// Leaves out some time that has passed, such as a pause.
    pub fn exclude(&mut self, time: Duration) {
        self.started += time;
        self.marked.0 += time;
    }

    /// Steps per second between the last two marks.
    pub fn steps_per_second(&self) -> f64 {
        self.steps_per_second
    }

    /// Seconds since the start.
    pub fn elapsed(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// The remaining time for `steps` more steps, for people.
    pub fn left(&self, steps: usize) -> String {
        match self.steps_per_second > 0.0 {
            true => format!("{} left", spoken(steps as f64 / self.steps_per_second)),
            false => String::new(),
        }
    }
}
