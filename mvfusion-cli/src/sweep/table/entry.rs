//! How a metric of the table reads, whatever the format.

use super::{Column, Entry, State, Table};
use crate::sweep::metric::TableMetric;

/// The mark of the paper's numbers that are not comparable.
pub(super) const DAGGER: char = '\u{2020}';

/// What stands in a field of the table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    /// The mean, or the word in its stead.
    pub text: String,
    /// Whether that is the best of its column.
    pub is_best: bool,
    /// Spread, and seeds that are missing.
    pub rest: String,
}

impl Entry {
    /// Ours minus the paper's.
    pub fn difference(&self) -> Option<f64> {
        Some(self.spread?.mean - self.paper?)
    }

    /// Whether the paper's number says something about ours: not if there is a reason against it. Absent where there is
    /// no number of the paper, or none of ours and no reason.
    pub fn is_comparable(&self) -> Option<bool> {
        self.paper?;
        if self.not_comparable.is_empty() { self.difference().map(|_| true) } else { Some(false) }
    }
}

impl Table {
    /// Our metric: `27.31 ± 0.12 (2 of 3 seeds)`.
    pub(super) fn field(&self, column: &Column, entry: &Entry) -> Field {
        let Some(spread) = entry.spread else {
            let word = match entry.state {
                State::Failed => "failed",
                State::NotTrained => "",
                State::Known | State::Unfinished | State::Unknown => "-",
            };
            return Field { text: word.to_owned(), is_best: false, rest: String::new() };
        };
        let deviation = spread.deviation.map(|deviation| format!(" \u{b1} {}", column.metric.shown(deviation)));
        let (complete, all) = (entry.seeds.len(), self.seeds.len());
        let missing = (complete < all).then(|| format!(" ({complete} of {all} seeds)"));
        let rest = deviation.unwrap_or_default() + &missing.unwrap_or_default();
        let shown = if entry.is_difference { TableMetric::signed } else { TableMetric::shown };
        Field { text: shown(&column.metric, spread.mean), is_best: entry.is_best, rest }
    }
}

impl Column {
    /// The paper's number with the difference of ours to it, marked where they are not comparable: `32.07 (-3.96)†`.
    /// Nothing where the paper has none.
    pub(super) fn paper_field(&self, entry: &Entry) -> String {
        let Some(paper) = entry.paper else { return String::new() };
        let decimals = self.paper_decimals.unwrap_or(self.metric.decimals);
        let rounded = self.metric.rounded(paper, decimals);
        // A frame in twenty seconds is not none.
        let is_lost = paper != 0.0 && !rounded.contains(|digit: char| ('1'..='9').contains(&digit));
        let paper = if is_lost { paper.to_string() } else { rounded };
        let paper = if entry.is_difference && !paper.starts_with('-') { format!("+{paper}") } else { paper };
        let dagger = if entry.is_comparable() == Some(false) { DAGGER.to_string() } else { String::new() };
        let Some(difference) = entry.difference() else { return paper + &dagger };
        format!("{paper} ({}){dagger}", self.metric.signed(difference))
    }
}
