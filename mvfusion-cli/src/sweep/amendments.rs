//! Changes of what decides in a grid, made after cells had finished. A rule is fixed beforehand only if there are none.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::index::Index;

/// A change of a grid that was made when some of its cells had finished, so that it may follow from their metrics.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Amendment {
    /// What changed: the rule, the differences, the seeds of a scene.
    pub parts: Vec<String>,
    /// Number of the cells that had finished.
    pub finished: usize,
}

/// The amendments of a sweep that has an index already: those that it had, and what `index` adds, if any cell of either has
/// finished. Without a rule, nothing is decided, and nothing is added.
pub(super) fn amendments(old: &Index, index: &Index, is_finished: impl Fn(&str) -> bool) -> Vec<Amendment> {
    let cells: BTreeSet<&str> = old.cells.iter().chain(&index.cells).map(|cell| cell.id.as_str()).collect();
    let finished = cells.into_iter().filter(|id| is_finished(id)).count();
    if finished == 0 || (old.rule.is_none() && index.rule.is_none()) {
        return old.amendments.clone();
    }
    let seeds = |index: &Index| -> BTreeSet<(String, u64)> {
        index.cells.iter().map(|cell| (cell.scene.clone(), cell.seed)).collect()
    };
    let changes = [
        ("rule", old.rule != index.rule),
        ("differences", old.differences != index.differences),
        ("seeds", seeds(old) != seeds(index)),
    ];
    let parts: Vec<String> =
        changes.into_iter().filter(|(_, is_changed)| *is_changed).map(|(part, _)| part.to_owned()).collect();
    let added = (!parts.is_empty()).then_some(Amendment { parts, finished });
    old.amendments.iter().cloned().chain(added).collect()
}

/// The amendments in a sentence: `The grid was changed after cells had finished: rule (40 cells).`
pub fn sentence(amendments: &[Amendment]) -> Option<String> {
    let of = |Amendment { parts, finished }: &Amendment| {
        format!("{} ({finished} {})", parts.join(", "), if *finished == 1 { "cell" } else { "cells" })
    };
    let changes: Vec<String> = amendments.iter().map(of).collect();
    (!changes.is_empty()).then(|| format!("The grid was changed after cells had finished: {}.", changes.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::super::grid::{Difference, Rule, RuleScene};
    use super::super::table::specimen::{cell, index as empty};
    use super::*;

    fn rule(least_helped: usize) -> Rule {
        let scenes = vec![RuleScene { scene: "a".into(), metrics: vec!["composed.psnr".into()] }];
        Rule { confidence: 0.95, least_helped, scenes }
    }

    fn index(rule: Option<Rule>, seeds: &[u64]) -> Index {
        let cells = seeds.iter().map(|&seed| cell("a", "", &[], seed)).collect();
        Index { rule, cells, ..empty(&[], Vec::new(), "") }
    }

    fn change(parts: &[&str], finished: usize) -> Amendment {
        Amendment { parts: parts.iter().map(|&part| part.to_owned()).collect(), finished }
    }

    #[test]
    fn a_rule_that_changes_after_cells_have_finished_is_an_amendment() {
        let old = index(Some(rule(2)), &[1, 2]);
        let first = old.cells[0].id.clone();
        let of = |new: &Index| amendments(&old, new, |id| id == first);
        assert_eq!(of(&old), []);
        assert_eq!(of(&index(Some(rule(1)), &[1, 2])), [change(&["rule"], 1)]);
        assert_eq!(of(&index(None, &[1, 2])), [change(&["rule"], 1)]);
        assert_eq!(of(&index(Some(rule(1)), &[1, 2, 3])), [change(&["rule", "seeds"], 1)]);
        let differences = vec![Difference { variant: "full".into(), minus: "base".into() }];
        assert_eq!(of(&Index { differences, ..old.clone() }), [change(&["differences"], 1)]);
    }

    #[test]
    fn a_change_before_the_first_cell_has_finished_is_none() {
        let old = index(Some(rule(2)), &[1, 2]);
        assert_eq!(amendments(&old, &index(Some(rule(1)), &[1, 2]), |_| false), []);
        assert_eq!(amendments(&index(None, &[1]), &index(None, &[1, 2]), |_| true), [], "no rule");
    }

    #[test]
    fn a_change_that_leaves_no_finished_cell_is_an_amendment() {
        let old = index(Some(rule(2)), &[1, 2]);
        let found = amendments(&old, &index(Some(rule(1)), &[3]), |id| id == old.cells[0].id);
        assert!(!found.is_empty() && found.iter().all(|amendment| amendment.finished == 1), "{found:?}");
    }

    #[test]
    fn earlier_amendments_stay() {
        let old = Index { amendments: vec![change(&["rule"], 40)], ..index(Some(rule(2)), &[1]) };
        let kept = amendments(&old, &index(Some(rule(2)), &[1]), |_| true);
        let more = amendments(&old, &index(Some(rule(2)), &[1, 2]), |_| true);
        assert_eq!((&kept, more.len()), (&old.amendments, 2));
        assert_eq!(amendments(&old, &index(Some(rule(1)), &[7]), |_| false), old.amendments, "in a run of other cells");
        assert_eq!(sentence(&[]), None);
        let said = "The grid was changed after cells had finished: rule (40 cells); seeds (2 cells).";
        assert_eq!(sentence(&more).as_deref(), Some(said));
    }
}
