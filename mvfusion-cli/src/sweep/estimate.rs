//! Time estimates of cells, from those that have finished.

use std::collections::BTreeMap;

use super::folder::{State, SweepFolder};
use super::grid::Expected;
use super::index::{Cell, Index};
use crate::run::Results;

/// Seconds per step of the finished cells, by scene and variant.
#[derive(Clone, Debug, Default)]
pub struct Estimate {
    seen: BTreeMap<(String, String), Pace>,
    /// The estimate of the grid, used before any cell has finished.
    expected: Option<Expected>,
    /// Whether parts of it come from probes.
    is_probed: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct Pace {
    seconds: f64,
    steps: usize,
}

impl Pace {
    fn with(self, other: Self) -> Self {
        Self { seconds: self.seconds + other.seconds, steps: self.steps + other.steps }
    }

    fn of(self, cell: &Cell) -> Option<f64> {
        (self.steps > 0).then(|| self.seconds / self.steps as f64 * cell.steps as f64)
    }
}

impl Estimate {
    /// An estimate from the finished cells of a sweep.
    ///
    /// # Errors
    /// As [`SweepFolder::state`].
    pub fn new(folder: &SweepFolder, index: &Index) -> anyhow::Result<Self> {
        let mut estimate = Self { expected: index.expected.clone(), ..Self::default() };
        for cell in &index.cells {
            let is_finished = folder.state(&cell.id, &index.wanted)? == State::Finished;
            if let Some(results) = folder.results(&cell.id).filter(|_| is_finished) {
                estimate.add_finished(cell, &results);
            }
        }
        Ok(estimate)
    }

    /// Adds a finished cell with the seconds of its training and its evaluation, however often it was interrupted. If its
    /// training's are lost, it says nothing.
    pub fn add_finished(&mut self, cell: &Cell, results: &Results) {
        if let Some(train) = results.train {
            self.add(cell, train.seconds + results.eval.seconds);
        }
    }

    /// Adds a finished cell with its seconds.
    fn add(&mut self, cell: &Cell, seconds: f64) {
        let pace = self.seen.entry(key(cell)).or_default();
        *pace = pace.with(Pace { seconds, steps: cell.steps });
    }

    /// Adds a probed cell with its estimated seconds, unless a similar cell has finished.
    pub fn add_probe(&mut self, cell: &Cell, seconds: f64) {
        if !self.seen.contains_key(&key(cell)) {
            self.add(cell, seconds);
            self.is_probed = true;
        }
    }

    /// Estimated seconds of cells with `jobs` at a time; `None` without any data.
    pub fn seconds<'a>(&self, cells: impl Iterator<Item = &'a Cell>, jobs: usize) -> Option<f64> {
        let each: Vec<f64> = cells.map(|cell| self.one(cell)).collect::<Option<_>>()?;
        let longest = each.iter().copied().fold(0.0, f64::max);
        Some(longest.max(each.iter().sum::<f64>() / jobs.max(1) as f64))
    }

    /// Seconds of a cell: from finished cells of its scene and variant, of its scene, or of any scene; otherwise from
    /// the grid.
    fn one(&self, cell: &Cell) -> Option<f64> {
        let pace = |matches: &dyn Fn(&(String, String)) -> bool| {
            self.seen.iter().filter(|(key, _)| matches(key)).fold(Pace::default(), |sum, (_, pace)| sum.with(*pace))
        };
        pace(&|other| *other == key(cell))
            .of(cell)
            .or_else(|| pace(&|(scene, _)| *scene == cell.scene).of(cell))
            .or_else(|| pace(&|_| true).of(cell))
            .or_else(|| self.expected.as_ref().map(|expected| 60.0 * expected.minutes))
    }

    /// The basis of the estimate, in words.
    pub fn ground(&self) -> String {
        match (self.seen.is_empty(), &self.expected) {
            (false, _) if self.is_probed => "estimated from a few steps of the cells".to_owned(),
            (false, _) => "estimated from the finished cells".to_owned(),
            (true, Some(expected)) => {
                format!("estimate of the grid: {} min per cell on {}", expected.minutes, expected.on)
            }
            (true, None) => "no estimate until a cell has finished; --probe runs a few steps".to_owned(),
        }
    }
}

fn key(cell: &Cell) -> (String, String) {
    (cell.scene.clone(), cell.variant.clone())
}

#[cfg(test)]
mod tests {
    use mvfusion_model::evaluation::Scores;

    use super::*;
    use crate::run::{TrainCost, specimen};

    fn cell(scene: &str, variant: &str, steps: usize) -> Cell {
        Cell {
            id: String::new(),
            scene: scene.into(),
            variant: variant.into(),
            values: Vec::new(),
            seed: 0,
            preset: "quickstart".into(),
            steps,
            not_comparable: None,
        }
    }

    #[test]
    fn a_finished_cell_counts_with_all_the_seconds_of_its_training() {
        let (mut estimate, mut results) = (Estimate::default(), specimen(Scores::default()));
        let one = |estimate: &Estimate| estimate.seconds([&cell("a", "x", 10)].into_iter(), 1);
        results.eval.seconds = 20.0;
        results.train = None;
        estimate.add_finished(&cell("a", "x", 100), &results);
        assert_eq!(one(&estimate), None, "the evaluation alone is no pace");
        results.train = Some(TrainCost { seconds: 80.0, steps: 100, skipped: 0, peak_memory: None });
        estimate.add_finished(&cell("a", "x", 100), &results);
        assert_eq!(one(&estimate), Some(10.0));
    }

    #[test]
    fn the_most_similar_finished_cells_count() {
        let mut estimate = Estimate::default();
        assert_eq!(estimate.seconds([&cell("a", "x", 10)].into_iter(), 1), None);
        estimate.expected = Some(Expected { minutes: 2.0, on: "a machine".into() });
        assert_eq!(estimate.seconds([&cell("a", "x", 10)].into_iter(), 1), Some(120.0));
        estimate.add(&cell("a", "x", 100), 50.0);
        estimate.add(&cell("a", "y", 100), 150.0);
        let one = |scene, variant| estimate.seconds([&cell(scene, variant, 10)].into_iter(), 1).expect("known");
        assert_eq!((one("a", "x"), one("a", "z"), one("b", "x")), (5.0, 10.0, 10.0));
        let two = [cell("a", "x", 10), cell("a", "y", 10)];
        assert_eq!(estimate.seconds(two.iter(), 1), Some(20.0));
        assert_eq!(estimate.seconds(two.iter(), 2), Some(15.0), "the longer of the two");
    }
}
