//! The seconds of a film, and the times of a model.

use mvfusion_model::timeline::Timeline;

/// Frames a second of the training times.
const FPS: f64 = 30.0;

/// A film in which every training time is one frame. Frame `i` lasts from `i / 30` to `(i + 1) / 30` seconds and shows
/// the time of its frame in the middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    first: f64,
    last: f64,
    spacing: f64,
    frames: usize,
}

impl Clock {
    /// The film of these training times.
    pub fn of(timeline: &Timeline) -> Self {
        let times = timeline.times();
        let (first, last) = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(0.0));
        Self { first, last, spacing: timeline.spacing(), frames: times.len() }
    }

    /// Length of the film, seconds.
    pub fn duration(&self) -> f64 {
        self.frames as f64 / FPS
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The model's time at a second, within the training times.
    pub fn time(&self, second: f64) -> f64 {
        (self.first + (second * FPS - 0.5) * self.spacing).clamp(self.first, self.last)
    }

    /// The second of a model's time.
    pub fn second(&self, time: f64) -> f64 {
        (((time - self.first) / self.spacing + 0.5) / FPS).clamp(0.0, self.duration())
    }

    /// The ends of `count` equal parts of the film: one more than parts, each but the last rounded to a multiple of
    /// `step` seconds.
    pub fn ends(&self, count: usize, step: f64) -> Vec<f64> {
        let duration = self.duration();
        let end = |part: usize| match part == count {
            true => duration,
            false => (duration * part as f64 / count as f64 / step).round() * step,
        };
        (0..=count).map(end).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock() -> Clock {
        Clock::of(&Timeline::new((0..60).map(|frame| f64::from(frame) / 60.0).collect()))
    }

    #[test]
    fn a_frame_shows_its_time_in_its_middle() {
        let clock = clock();
        assert_eq!((clock.duration(), clock.frames()), (2.0, 60));
        assert!((clock.time(10.5 / 30.0) - 10.0 / 60.0).abs() < 1e-12);
        assert!((clock.second(10.0 / 60.0) - 10.5 / 30.0).abs() < 1e-12);
        // Half a frame before the first time there is nothing new.
        assert_eq!((clock.time(0.0), clock.time(2.0)), (0.0, 59.0 / 60.0));
    }

    #[test]
    fn parts_fill_the_film_and_end_at_multiples_of_a_step() {
        let ends = clock().ends(7, 0.001);
        assert_eq!((ends.len(), ends[0], ends[7]), (8, 0.0, 2.0));
        assert!((ends[1] - 0.286).abs() < 1e-12 && ends.is_sorted_by(|a, b| a < b), "{ends:?}");
    }

    #[test]
    fn one_moment_is_a_film_of_one_frame() {
        let clock = Clock::of(&Timeline::new(vec![0.25]));
        assert_eq!((clock.frames(), clock.time(0.0), clock.time(1.0 / 30.0)), (1, 0.25, 0.25));
        assert_eq!(clock.ends(1, 0.001), [0.0, 1.0 / 30.0]);
    }
}
