//! What every page is sent: the state of the training, and its curves.

use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;
use tokio::sync::watch;

/// Most points of the curves. A page cannot show more, and a long training must not grow them.
const MOST_POINTS: usize = 2000;

/// The state of a program that shows a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Status {
    /// What it does.
    pub activity: Activity,
    /// Steps done.
    pub step: usize,
    /// Steps of the whole run.
    pub total: usize,
    /// Name of the stage.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stage: Option<&'static str>,
    /// Steps per second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps_per_second: Option<f64>,
    /// The layers that the model cannot show now, each with the reason.
    pub unavailable: Vec<(&'static str, &'static str)>,
    /// The checkpoint that was saved last on request.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub saved: Option<String>,
}

/// What the program does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Activity {
    /// It shows a trained run.
    Shows,
    /// It trains.
    Trains,
    /// The training pauses.
    Pauses,
    /// The training is done, and its result is scored. No pictures are rendered.
    Scores,
}

/// A point of the curves: step, loss, PSNR.
pub type CurvePoint = (usize, f32, Option<f64>);

/// The state, shared by the server and the thread that renders.
#[derive(Debug)]
pub struct StatusBoard {
    status: watch::Sender<Status>,
    curves: Mutex<Curves>,
}

#[derive(Debug, Default)]
struct Curves {
    points: Vec<CurvePoint>,
    /// Only every so many points are kept.
    every: usize,
    seen: usize,
}

impl StatusBoard {
    /// The first state.
    pub fn new(status: Status) -> Self {
        Self { status: watch::Sender::new(status), curves: Mutex::default() }
    }

    /// A receiver of every later state.
    pub fn subscribe(&self) -> watch::Receiver<Status> {
        self.status.subscribe()
    }

    /// Changes the state and sends it to every page.
    pub fn change(&self, change: impl FnOnce(&mut Status)) {
        self.status.send_modify(change);
    }

    /// What the program does.
    pub fn activity(&self) -> Activity {
        self.status.borrow().activity
    }

    /// Adds a point to the curves.
    pub fn add(&self, point: CurvePoint) {
        self.curves().add(point);
    }

    /// The points after a step.
    pub fn points_after(&self, step: Option<usize>) -> Vec<CurvePoint> {
        let curves = self.curves();
        let first = step.map_or(0, |step| curves.points.partition_point(|point| point.0 <= step));
        curves.points[first..].to_vec()
    }

    fn curves(&self) -> MutexGuard<'_, Curves> {
        self.curves.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Curves {
    fn add(&mut self, point: CurvePoint) {
        let every = self.every.max(1);
        self.seen += 1;
        if !self.seen.is_multiple_of(every) {
            return;
        }
        self.points.push(point);
        if self.points.len() > MOST_POINTS {
            let mut index = 0;
            self.points.retain(|_| {
                index += 1;
                index % 2 == 0
            });
            self.every = 2 * every;
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// The state of a training.
    pub fn status() -> Status {
        Status {
            activity: Activity::Trains,
            step: 0,
            total: 100,
            stage: Some("geometry"),
            steps_per_second: None,
            unavailable: Vec::new(),
            saved: None,
        }
    }

    #[test]
    fn curves_keep_their_length_and_their_ends() {
        let board = StatusBoard::new(status());
        (1..=100_000).for_each(|step| board.add((step, 1.0 / step as f32, None)));
        let points = board.points_after(None);
        assert!((MOST_POINTS / 2..=MOST_POINTS).contains(&points.len()), "{}", points.len());
        assert!(points.is_sorted_by_key(|point| point.0));
        assert!(points[0].0 < 200 && points[points.len() - 1].0 > 99_800, "{:?}", points[0]);
    }

    #[test]
    fn a_page_gets_only_what_it_has_not_seen() {
        let board = StatusBoard::new(status());
        (1..=5).for_each(|step| board.add((10 * step, 0.5, Some(20.0))));
        let steps = |after| board.points_after(after).iter().map(|point| point.0).collect::<Vec<_>>();
        assert_eq!((steps(Some(30)), steps(Some(50))), (vec![40, 50], vec![]));
    }

    #[test]
    fn a_change_reaches_those_who_subscribe() {
        let board = StatusBoard::new(status());
        let mut follower = board.subscribe();
        assert!(!follower.has_changed().expect("open"));
        board.change(|status| status.step = 7);
        assert_eq!(follower.borrow_and_update().step, 7);
    }
}
