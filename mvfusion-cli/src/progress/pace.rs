//! The speed of the steps of a task.

use std::time::{Duration, Instant};

use crate::clock::spoken;

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
        self.seconds_left(steps).map_or(String::new(), |seconds| format!("{} left", spoken(seconds)))
    }

    /// The seconds that `steps` more steps take; `None` before the speed is known.
    pub fn seconds_left(&self, steps: usize) -> Option<f64> {
        (self.steps_per_second > 0.0).then(|| steps as f64 / self.steps_per_second)
    }
}
