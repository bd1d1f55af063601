//! What the metrics of a table depend on beside the configuration of its cells. A cell's id holds the configuration
//! alone, so a sweep may be continued by another program, or on another machine.

use std::collections::BTreeMap;

use super::{Outcome, Table, TrainedCell};
use crate::run::{Results, RunRecord};

/// Digits of a commit.
const DIGITS: usize = 7;

/// Where a cell's metrics come from.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Origin {
    /// Name of the protocol.
    pub protocol: String,
    /// Commit of the program that trained.
    pub commit: Option<String>,
    /// Device of the training.
    pub device: String,
    /// Processor of the evaluation.
    pub processor: Option<String>,
    /// GPU of the evaluation.
    pub gpu: Option<String>,
}

impl Origin {
    /// That of a finished run.
    pub fn of(record: &RunRecord, results: &Results) -> Self {
        let commit = record.git.as_ref().map(|git| {
            let short: String = git.commit.chars().take(DIGITS).collect();
            if git.dirty { format!("{short} with changes") } else { short }
        });
        let name = results.protocol.split_once(':').map_or(results.protocol.as_str(), |(name, _)| name);
        Self {
            protocol: name.to_owned(),
            commit,
            device: record.device.clone(),
            processor: results.machine.as_ref().and_then(|machine| machine.cpu.clone()),
            gpu: results.machine.as_ref().and_then(|machine| Some(machine.gpu.as_ref()?.name.clone())),
        }
    }
}

/// The name of a part of the origin, and where it is.
type Part = (&'static str, fn(&Origin) -> Option<&String>);

/// A part of the origin in which cells differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mixture {
    /// The part.
    part: &'static str,
    /// Its values, each with the number of finished cells.
    counts: BTreeMap<String, usize>,
}

/// The parts in which the finished cells differ. What a cell does not know differs from nothing.
pub(super) fn mixtures(cells: &[TrainedCell]) -> Vec<Mixture> {
    let origins: Vec<&Origin> = cells
        .iter()
        .filter_map(|(_, outcome)| match outcome {
            Outcome::Metrics(metrics) => Some(&metrics.origin),
            Outcome::Failed | Outcome::Unfinished => None,
        })
        .collect();
    let parts: [Part; 5] = [
        ("protocol", |origin| Some(&origin.protocol)),
        ("commit", |origin| origin.commit.as_ref()),
        ("device", |origin| Some(&origin.device)),
        ("processor", |origin| origin.processor.as_ref()),
        ("GPU", |origin| origin.gpu.as_ref()),
    ];
    let mixture = |(part, of): Part| {
        let mut counts = BTreeMap::new();
        for value in origins.iter().copied().filter_map(of) {
            *counts.entry(value.clone()).or_default() += 1;
        }
        (counts.len() > 1).then_some(Mixture { part, counts })
    };
    parts.into_iter().filter_map(mixture).collect()
}

impl Table {
    /// In what the finished cells differ beside their configuration.
    pub(super) fn origin_note(&self) -> Option<String> {
        let of = |Mixture { part, counts }: &Mixture| {
            let counts: Vec<String> = counts.iter().map(|(value, count)| format!("{value} ({count})")).collect();
            format!("{part} {}", counts.join(", "))
        };
        let mixtures: Vec<String> = self.mixtures.iter().map(of).collect();
        let note = || format!("The cells differ beyond their configuration: {}.", mixtures.join("; "));
        (!mixtures.is_empty()).then(note)
    }
}

#[cfg(test)]
mod tests {
    use super::super::CellMetrics;
    use super::super::specimen::{cell, group, index};
    use super::*;

    #[test]
    fn cells_of_two_programs_are_told_apart_below_the_table() {
        let mut index = index(&[], vec![group("a", &[], &["composed.psnr"])], "");
        index.cells = [0, 1, 2, 3].map(|seed| cell("a", "", &[], seed)).into();
        let outcome = |commit: Option<&str>, protocol: &str| {
            let origin =
                Origin { commit: commit.map(str::to_owned), protocol: protocol.to_owned(), ..Origin::default() };
            Outcome::Metrics(CellMetrics { origin, ..CellMetrics::default() })
        };
        let note = |outcomes: &[Outcome]| Table::of(&index, outcomes).origin_note();
        let (old, new) = (outcome(Some("2c7af13"), "mvfusion-3"), outcome(Some("570b89d"), "mvfusion-3"));
        assert_eq!(note(&[old.clone(), old.clone(), Outcome::Failed, outcome(None, "mvfusion-3")]), None);
        let said = "The cells differ beyond their configuration: commit 2c7af13 (2), 570b89d (1).";
        assert_eq!(note(&[old.clone(), old.clone(), new.clone()]).as_deref(), Some(said));
        let said = "The cells differ beyond their configuration: protocol mvfusion-2 (1), mvfusion-3 (1).";
        assert_eq!(note(&[old, outcome(None, "mvfusion-2")]).as_deref(), Some(said));
    }
}
