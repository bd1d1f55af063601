//! Tests of the means, spreads, labels and marks.

use super::super::specimen::{ablation, cell, group, index, metrics, windows};
use super::*;

fn labels(table: &Table) -> Vec<String> {
    table.rows.iter().map(|row| row.labels.join(", ")).collect()
}

/// Fields of our metrics, row by row.
fn fields(table: &Table) -> Vec<Vec<String>> {
    let field = |(column, entry)| {
        let field = table.field(column, entry);
        format!("{}{}{}", field.text, if field.is_best { "!" } else { "" }, field.rest)
    };
    table.rows.iter().map(|row| table.columns.iter().zip(&row.entries).map(field).collect()).collect()
}

#[test]
fn metrics_are_averaged_over_scenes_and_then_over_seeds() {
    let (index, outcomes) = ablation();
    let table = Table::of(&index, &outcomes);
    let full = &table.rows[2].entries[0];
    let means = [(0, 28.0), (1, 29.0), (2, 30.0)].map(|(seed, mean)| SeedMean { seed, mean });
    assert_eq!(full.seeds, means);
    assert_eq!(full.spread, Some(Spread { mean: 29.0, deviation: Some(1.0) }));
    assert_eq!(full.difference().map(|difference| (difference * 100.0).round()), Some(-307.0));
}

#[test]
fn seeds_and_cells_that_are_missing_are_said() {
    let (index, outcomes) = ablation();
    let table = Table::of(&index, &outcomes);
    assert_eq!(labels(&table), ["3DGS_2023", "w/o MVG|MFTA", "full", "broken"]);
    assert_eq!(table.headings, ["method"]);
    let shown = fields(&table);
    assert_eq!(shown[0], [""; 5]);
    assert_eq!(
        shown[1],
        [
            "27.50 \u{b1} 0.71 (2 of 3 seeds)",
            "0.9000 \u{b1} 0.0000 (2 of 3 seeds)",
            "-",
            "29.00 \u{b1} 1.00",
            "12,346! \u{b1} 1"
        ]
    );
    assert_eq!(
        shown[2],
        // Nothing is the best where no other row has all seeds.
        ["29.00 \u{b1} 1.00", "0.9000 \u{b1} 0.0000", "-", "30.00! \u{b1} 1.00", "12,346! \u{b1} 1"]
    );
    // Seed 2 finished without a PSNR, so that nothing is known; its SSIM is.
    assert_eq!(shown[3], ["-", "0.8250 (1 of 3 seeds)", "-", "29.00 \u{b1} 1.00", "12,346! \u{b1} 1"]);
    assert_eq!(table.rows[3].entries[0].state, State::Unknown);
}

#[test]
fn an_entry_whose_cells_failed_says_so() {
    let mut index = index(&[], vec![group("All", &[], &["composed.psnr"])], "");
    index.cells = vec![cell("a", "x", &[], 0), cell("b", "x", &[], 0), cell("a", "y", &[], 0), cell("b", "y", &[], 0)];
    let known = metrics(&[("composed.psnr", 20.0)]);
    let outcomes = [known.clone(), Outcome::Failed, known, Outcome::Unfinished];
    let table = Table::of(&index, &outcomes);
    assert_eq!(fields(&table), [["failed"], ["-"]]);
    assert_eq!([State::Failed, State::Unfinished], [0, 1].map(|row: usize| table.rows[row].entries[0].state));
    assert_eq!(table.cells, CellCounts { total: 4, failed: 1, unfinished: 1 });
}

#[test]
fn a_difference_without_a_common_seed_is_not_known() {
    let mut index = index(&[], vec![group("All", &[], &["composed.psnr"])], "");
    index.differences = vec![Difference { variant: "x".into(), minus: "y".into() }];
    index.cells = [("x", 0), ("x", 1), ("y", 0), ("y", 1)].map(|(variant, seed)| cell("a", variant, &[], seed)).into();
    let known = metrics(&[("composed.psnr", 20.0)]);
    let table = Table::of(&index, &[known.clone(), Outcome::Unfinished, Outcome::Unfinished, known]);
    let difference = &table.rows[2].entries[0];
    assert_eq!((difference.state, difference.spread), (State::Unfinished, None));
}

#[test]
fn a_seed_that_failed_does_not_hide_those_that_did_not() {
    let mut index = index(&[], vec![group("All", &[], &["composed.psnr"])], "");
    index.cells = vec![cell("a", "x", &[], 0), cell("a", "x", &[], 7)];
    let table = Table::of(&index, &[Outcome::Failed, metrics(&[("composed.psnr", 20.0)])]);
    assert_eq!(fields(&table), [["20.00 (1 of 2 seeds)"]]);
    let table = Table::of(&index, &[metrics(&[("composed.psnr", f64::NAN)]), metrics(&[("composed.psnr", 20.0)])]);
    assert_eq!(fields(&table), [["20.00 (1 of 2 seeds)"]]);
}

#[test]
fn labels_that_are_the_same_everywhere_are_left_out() {
    let (index, outcomes) = windows();
    let table = Table::of(&index, &outcomes);
    assert_eq!(table.headings, ["motion.window"]);
    assert_eq!(labels(&table), ["9", "3", "5"]);
    let mut alone = super::super::specimen::index(&["key"], vec![], "");
    alone.cells = vec![cell("a", "only", &["1"], 0)];
    assert_eq!(Table::of(&alone, &[]).headings, ["variant"]);
    alone.cells = vec![cell("a", "", &["1"], 0)];
    assert!(Table::of(&alone, &[]).headings.is_empty());
    alone.cells = vec![cell("a", "", &["\"one\""], 0), cell("a", "", &["[2, 3]"], 0)];
    assert_eq!(labels(&Table::of(&alone, &[])), ["one", "[2, 3]"]);
}

#[test]
fn ours_have_a_name_beside_the_literature() {
    let paper = "
        [[paper]]
        literature = '4DGS'
        column = 'All'
        values = { 'composed.psnr' = 31.0 }
        [[paper]]
        literature = '4DGS'
        column = 'All'
        at = { key = 2 }
        values = { 'composed.psnr' = 32.0 }
        [[paper]]
        literature = '4DGS'
        column = 'All'
        values = { 'composed.ssim' = 0.9 }
        ";
    let mut index = index(&["key"], vec![group("All", &[], &["composed.psnr", "composed.ssim"])], paper);
    index.cells = vec![cell("a", "", &["1"], 0), cell("a", "", &["2"], 0)];
    let table = Table::of(&index, &[]);
    assert_eq!(labels(&table), ["4DGS, ", "4DGS, 2", "ours, 1", "ours, 2"]);
    assert_eq!(table.rows[0].entries.iter().map(|entry| entry.paper).collect::<Vec<_>>(), [Some(31.0), Some(0.9)]);
    assert_eq!(table.rows[1].entries[0].paper, Some(32.0));
    assert_eq!(table.rows[2].entries[0].paper, None);
}

#[test]
fn the_best_is_what_looks_best_and_needs_a_rival() {
    let mut index = index(&["key"], vec![group("All", &[], &["composed.psnr", "composed.lpips_alex", "odd"])], "");
    let rows = [("1", 20.001, 0.2), ("2", 20.004, 0.1), ("3", 19.99, 0.1)];
    index.cells = rows.iter().map(|(value, ..)| cell("a", "", &[value], 0)).collect();
    let outcomes =
        rows.map(|(_, psnr, lpips)| metrics(&[("composed.psnr", psnr), ("composed.lpips_alex", lpips), ("odd", 1.0)]));
    let table = Table::of(&index, &outcomes);
    let best = |column: usize| table.rows.iter().map(|row| row.entries[column].is_best).collect::<Vec<_>>();
    assert_eq!(best(0), [true, true, false]);
    assert_eq!(best(1), [false, true, true]);
    assert_eq!(best(2), [false; 3]);
    let alone = Table::of(&index, &outcomes[..1]);
    assert!(alone.rows.iter().all(|row| row.entries.iter().all(|entry| !entry.is_best)));
}

#[test]
fn the_papers_numbers_keep_the_papers_digits() {
    let (index, outcomes) = ablation();
    let table = Table::of(&index, &outcomes);
    let papers = |row: usize| -> Vec<String> {
        table.columns.iter().zip(&table.rows[row].entries).map(|(column, entry)| column.paper_field(entry)).collect()
    };
    assert_eq!(papers(0), ["30.50", "0.940", "", "", ""]);
    assert_eq!(papers(1), [""; 5]);
    assert_eq!(papers(2), ["32.07 (-3.07)\u{2020}", "0.943 (-0.0430)\u{2020}", "", "", ""]);
    assert_eq!(papers(3), ["31.52", "", "", "", ""]);
    assert_eq!(
        table.columns.iter().map(|c| c.paper_decimals).collect::<Vec<_>>(),
        [Some(2), Some(3), None, None, None]
    );
}

#[test]
fn differences_are_paired_by_seed_and_have_signs() {
    let (mut index, outcomes) = ablation();
    let before = Table::of(&index, &outcomes).rows;
    index.differences = vec![Difference { variant: "full".into(), minus: "w/o MVG|MFTA".into() }];
    let table = Table::of(&index, &outcomes);
    let (row, others) = table.rows.split_last().expect("rows");
    assert_eq!(others, before, "no other row changes");
    assert_eq!(row.labels, ["full - w/o MVG|MFTA"]);
    // Seed 2 of the other variant is not finished.
    assert_eq!(row.entries[0].seeds, [0, 1].map(|seed| SeedMean { seed, mean: 1.0 }));
    let shown = fields(&table);
    let missing = "(2 of 3 seeds)";
    assert_eq!(
        shown[4],
        [
            format!("+1.00 \u{b1} 0.00 {missing}"),
            format!("0.0000 \u{b1} 0.0000 {missing}"),
            "-".to_owned(),
            "+1.00 \u{b1} 0.00".to_owned(),
            "0 \u{b1} 0".to_owned()
        ]
    );
    assert!(table.latex().contains("\\midrule\nfull - "), "{}", table.latex());
    let json = serde_json::to_value(table.json()).expect("written");
    assert_eq!((&json["rows"][4]["variant"], &json["rows"][4]["minus"]), (&"full".into(), &"w/o MVG|MFTA".into()));
    assert!(table.notes().iter().any(|note| note.starts_with("A - B: ")));
}

#[test]
fn a_difference_has_that_of_the_papers_numbers_beside_it() {
    let (mut index, outcomes) = ablation();
    index.differences = vec![Difference { variant: "full".into(), minus: "broken".into() }];
    let table = Table::of(&index, &outcomes);
    let entry = &table.rows[4].entries[0];
    assert_eq!(entry.spread, None, "no seed of `broken` has this metric");
    assert_eq!(table.columns[0].paper_field(entry), "+0.55\u{2020}");
}
