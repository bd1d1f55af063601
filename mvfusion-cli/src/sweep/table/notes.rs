//! What has to be said below a table.

use super::entry::DAGGER;
use super::{Entry, Table};

impl Table {
    /// The notes, a sentence or two each.
    pub fn notes(&self) -> Vec<String> {
        [self.spread_note(), self.best_note(), self.paper_note(), self.comparable_note(), self.cells_note()]
            .into_iter()
            .flatten()
            .collect()
    }

    fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.rows.iter().flat_map(|row| &row.entries)
    }

    fn spread_note(&self) -> Option<String> {
        match self.seeds.len() {
            0 => None,
            1 => Some("One seed: means over the scenes of a column, without a spread.".to_owned()),
            seeds => Some(format!(
                "{seeds} seeds: mean \u{b1} sample standard deviation (n - 1) over seeds of the means over the scenes \
                 of a column."
            )),
        }
    }

    fn best_note(&self) -> Option<String> {
        self.entries().any(|entry| entry.is_best).then(|| "Bold: the best of those trained here.".to_owned())
    }

    fn paper_note(&self) -> Option<String> {
        let has_difference = self.entries().any(|entry| entry.difference().is_some());
        let has_paper = self.entries().any(|entry| entry.paper.is_some());
        let brackets = if has_difference { ", and in brackets ours minus that" } else { "" };
        has_paper.then(|| format!("paper: the number that the paper gives{brackets}."))
    }

    fn comparable_note(&self) -> Option<String> {
        let mut reasons: Vec<&str> = Vec::new();
        for reason in
            self.entries().filter(|entry| entry.is_comparable() == Some(false)).flat_map(|e| &e.not_comparable)
        {
            if !reasons.contains(&reason.as_str()) {
                reasons.push(reason);
            }
        }
        (!reasons.is_empty()).then(|| format!("{DAGGER} not comparable: {}.", reasons.join("; ")))
    }

    fn cells_note(&self) -> Option<String> {
        let counts = self.cells;
        let of = format!("of {} {}", counts.total, if counts.total == 1 { "cell" } else { "cells" });
        let is = if counts.unfinished == 1 { "is" } else { "are" };
        match (counts.failed, counts.unfinished) {
            (0, 0) => None,
            (failed, 0) => Some(format!("{failed} {of} failed.")),
            (0, unfinished) => Some(format!("{unfinished} {of} {is} not finished.")),
            (failed, unfinished) => Some(format!("{failed} {of} failed, {unfinished} {is} not finished.")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::specimen::{ablation, windows};
    use super::*;
    use crate::sweep::table::{CellCounts, Outcome};

    #[test]
    fn the_notes_name_seeds_reasons_and_what_is_missing() {
        let (index, outcomes) = ablation();
        assert_eq!(
            Table::of(&index, &outcomes).notes(),
            [
                "3 seeds: mean \u{b1} sample standard deviation (n - 1) over seeds of the means over the scenes of a \
                 column.",
                "Bold: the best of those trained here.",
                "paper: the number that the paper gives, and in brackets ours minus that.",
                "\u{2020} not comparable: built-in scene; train.scale = 0.3.",
                "2 of 18 cells failed, 1 is not finished.",
            ]
        );
    }

    #[test]
    fn one_seed_has_no_spread() {
        let (mut index, mut outcomes) = windows();
        (index.cells, outcomes) = index.cells.into_iter().zip(outcomes).filter(|(cell, _)| cell.seed == 0).unzip();
        let notes = Table::of(&index, &outcomes).notes();
        assert_eq!(notes[0], "One seed: means over the scenes of a column, without a spread.");
    }

    #[test]
    fn counts_are_said_in_english() {
        let (index, _) = windows();
        let note = |total, failed, unfinished| {
            let table = Table { cells: CellCounts { total, failed, unfinished }, ..Table::of(&index, &[]) };
            table.cells_note()
        };
        assert_eq!(note(36, 0, 0), None);
        assert_eq!(note(36, 2, 0).as_deref(), Some("2 of 36 cells failed."));
        assert_eq!(note(36, 0, 1).as_deref(), Some("1 of 36 cells is not finished."));
        assert_eq!(note(1, 0, 1).as_deref(), Some("1 of 1 cell is not finished."));
        assert_eq!(note(36, 2, 3).as_deref(), Some("2 of 36 cells failed, 3 are not finished."));
        let unfinished = vec![Outcome::Unfinished; index.cells.len()];
        assert_eq!(Table::of(&index, &unfinished), Table::of(&index, &[]));
    }
}
