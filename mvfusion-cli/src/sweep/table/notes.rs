//! What has to be said below a table.

use mvfusion_model::evaluation::Backbone;

use super::entry::DAGGER;
use super::{Entry, Method, State, Table};
use crate::sweep::amendments;
use crate::sweep::metric::lpips_network;

impl Table {
    /// The notes, a sentence or two each.
    pub fn notes(&self) -> Vec<String> {
        let notes = [
            self.spread_note(),
            self.difference_note(),
            self.best_note(),
            self.paper_note(),
            self.comparable_note(),
            self.region_note(),
            self.lpips_note(),
            self.origin_note(),
            amendments::sentence(&self.amendments),
            self.cells_note(),
        ];
        notes.into_iter().flatten().collect()
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

    fn difference_note(&self) -> Option<String> {
        let has_differences = self.rows.iter().any(|row| matches!(row.method, Method::Difference { .. }));
        has_differences.then(|| "A - B: the mean over seeds of the differences of the same seed.".to_owned())
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

    /// Why LPIPS is absent, where that is for want of weights.
    fn lpips_note(&self) -> Option<String> {
        let has = |network: Backbone, state: State| {
            let is_of_network = |place: &usize| lpips_network(&self.columns[*place].metric.name) == Some(network);
            let mut places = (0..self.columns.len()).filter(is_of_network);
            places.any(|place| self.rows.iter().any(|row| row.entries[place].state == state))
        };
        let is_missed = |network: &Backbone| {
            let had_weights = self.wanted.lpips.contains_key(network.name());
            !had_weights && has(*network, State::Unknown) && !has(*network, State::Known)
        };
        let missed: Vec<&str> = Backbone::ALL.into_iter().filter(is_missed).map(Backbone::name).collect();
        match &self.wanted.lpips_weights {
            _ if missed.is_empty() => None,
            None => Some("LPIPS: not measured, no weights were given (--lpips-weights).".to_owned()),
            Some(_) => Some(format!(
                "LPIPS by {}: not measured, --lpips-weights had no weights of it.",
                missed.join(" and by ")
            )),
        }
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
    use super::super::specimen::{ablation, cell, group, index, metrics, windows};
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
    fn lpips_that_no_weights_were_given_for_is_said_to_be_missing() {
        let columns = vec![group("a", &[], &["composed.lpips_alex", "static.lpips_alex", "composed.lpips_vgg"])];
        let mut index = index(&[], columns, "");
        index.cells = vec![cell("a", "", &[], 0)];
        let said = |index: &_, known: &[(&str, f64)]| Table::of(index, &[metrics(known)]).lpips_note();
        let (alex, vgg) = (("composed.lpips_alex", 0.1), ("composed.lpips_vgg", 0.1));
        assert_eq!(said(&index, &[]).as_deref(), Some("LPIPS: not measured, no weights were given (--lpips-weights)."));
        assert_eq!(Table::of(&index, &[]).lpips_note(), None, "nothing has finished");
        // That there is no static branch is another matter.
        assert_eq!(said(&index, &[alex, vgg]), None);
        index.wanted.lpips_weights = Some("weights".into());
        index.wanted.lpips.insert("alex".into(), "a".into());
        assert_eq!(
            said(&index, &[alex]).as_deref(),
            Some("LPIPS by vgg: not measured, --lpips-weights had no weights of it.")
        );
        // Its weights were there: the pictures were too small, or the like.
        assert_eq!(said(&index, &[vgg]), None);
        let table = Table::of(&index, &[metrics(&[alex])]);
        assert!(table.markdown().contains("LPIPS by vgg: not measured"), "{}", table.markdown());
        assert!(table.latex().contains("LPIPS by vgg: not measured"), "{}", table.latex());
        let json = serde_json::to_value(table.json()).expect("written");
        assert!(json["notes"].as_array().is_some_and(|notes| notes.len() == table.notes().len()), "{json}");
    }

    #[test]
    fn numbers_with_a_reason_of_the_papers_row_are_marked_and_explained() {
        let paper = "
            [[paper]]
            literature = '4DGS'
            column = 'a'
            values = { 'composed.psnr' = 30.0, 'mask_iou' = 0.5 }
            not_comparable = { 'mask_iou' = 'masks of its own' }
            [[paper]]
            column = 'a'
            values = { 'composed.psnr' = 32.0, 'mask_iou' = 0.6 }
            not_comparable = { '*' = 'other views' }
            ";
        let mut index = index(&[], vec![group("a", &[], &["composed.psnr", "mask_iou"])], paper);
        index.cells = vec![cell("a", "", &[], 0)];
        let table = Table::of(&index, &[metrics(&[("composed.psnr", 31.0)])]);
        let shown = |row: usize| {
            let entries = table.columns.iter().zip(&table.rows[row].entries);
            entries.map(|(column, entry)| column.paper_field(entry)).collect::<Vec<_>>()
        };
        assert_eq!(shown(0), ["30", "0.5\u{2020}"]);
        assert_eq!(shown(1), ["32 (-1.00)\u{2020}", "0.6\u{2020}"]);
        let note = "\u{2020} not comparable: masks of its own; other views.";
        assert_eq!(table.comparable_note().as_deref(), Some(note));
        assert!(table.csv().contains("composed.psnr,31,,1,32,-1,false"), "{}", table.csv());
        let json = serde_json::to_value(table.json()).expect("written");
        assert_eq!(json["rows"][0]["entries"][1]["not_comparable"], serde_json::json!(["masks of its own"]));
        assert!(table.latex().contains("0.5$^\\dagger$"), "{}", table.latex());
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
