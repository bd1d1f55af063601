//! `table.json`: all that is known of the table, in full precision.

use std::collections::BTreeMap;

use mvfusion_model::evaluation::Better;
use serde::Serialize;

use super::{CellCounts, Column, Entry, Method, Row, SeedMean, State, Table, Verdict, paper};
use crate::sweep::grid::Rule;

#[derive(Serialize)]
struct TableJson<'a> {
    name: &'a str,
    title: &'a str,
    about: &'a str,
    seeds: &'a [u64],
    cells: CellCounts,
    notes: Vec<String>,
    columns: Vec<ColumnJson<'a>>,
    rows: Vec<RowJson<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rule: Option<&'a Rule>,
    #[serde(skip_serializing_if = "<[Verdict]>::is_empty")]
    verdicts: &'a [Verdict],
}

#[derive(Serialize)]
struct ColumnJson<'a> {
    column: &'a str,
    scenes: &'a [String],
    metric: &'a str,
    label: &'a str,
    unit: Option<&'static str>,
    decimals: usize,
    better: Option<Better>,
}

/// A row is of a `variant`, of a `variant` less another (`minus`), or of the `literature`.
#[derive(Serialize)]
struct RowJson<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    literature: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    variant: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    minus: Option<&'a str>,
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    values: BTreeMap<&'a str, toml::Value>,
    labels: BTreeMap<&'a str, &'a str>,
    entries: Vec<EntryJson<'a>>,
}

#[derive(Serialize)]
struct EntryJson<'a> {
    column: &'a str,
    metric: &'a str,
    state: State,
    mean: Option<f64>,
    deviation: Option<f64>,
    seeds: &'a [SeedMean],
    best: bool,
    paper: Option<f64>,
    difference: Option<f64>,
    comparable: Option<bool>,
    not_comparable: &'a [String],
}

impl Table {
    /// The table as JSON; what is absent is `null`.
    pub fn json(&self) -> impl Serialize {
        TableJson {
            name: &self.name,
            title: &self.title,
            about: &self.about,
            seeds: &self.seeds,
            cells: self.cells,
            notes: self.notes(),
            columns: self.columns.iter().map(column_json).collect(),
            rows: self.rows.iter().map(|row| self.row_json(row)).collect(),
            rule: self.rule.as_ref(),
            verdicts: &self.verdicts,
        }
    }

    fn row_json<'a>(&'a self, row: &'a Row) -> RowJson<'a> {
        let (literature, variant, minus, values) = match &row.method {
            Method::Literature(name) => (Some(name.as_str()), None, None, &[][..]),
            Method::Trained { variant, values } => (None, Some(variant.as_str()), None, values.as_slice()),
            Method::Difference { variant, minus, values } => {
                (None, Some(variant.as_str()), Some(minus.as_str()), values.as_slice())
            }
        };
        let values = self.axes.iter().zip(values).map(|(key, value)| (key.as_str(), paper::parsed(value)));
        let labels = self.headings.iter().zip(&row.labels).map(|(heading, label)| (heading.as_str(), label.as_str()));
        let entries = self.columns.iter().zip(&row.entries).map(|(column, entry)| entry_json(column, entry));
        RowJson {
            literature,
            variant,
            minus,
            values: values.collect(),
            labels: labels.collect(),
            entries: entries.collect(),
        }
    }
}

fn column_json(column: &Column) -> ColumnJson<'_> {
    ColumnJson {
        column: &column.group,
        scenes: &column.scenes,
        metric: &column.metric.name,
        label: &column.metric.label,
        unit: column.metric.unit,
        decimals: column.metric.decimals,
        better: column.metric.better,
    }
}

fn entry_json<'a>(column: &'a Column, entry: &'a Entry) -> EntryJson<'a> {
    EntryJson {
        column: &column.group,
        metric: &column.metric.name,
        state: entry.state,
        mean: entry.spread.map(|spread| spread.mean),
        deviation: entry.spread.and_then(|spread| spread.deviation),
        seeds: &entry.seeds,
        best: entry.is_best,
        paper: entry.paper,
        difference: entry.difference(),
        comparable: entry.is_comparable(),
        not_comparable: &entry.not_comparable,
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::specimen::{ablation, windows};
    use super::*;

    #[test]
    fn an_entry_has_its_seeds_and_the_paper() {
        let (index, outcomes) = ablation();
        let json = serde_json::to_value(Table::of(&index, &outcomes).json()).expect("written");
        assert_eq!(json["cells"], json!({ "total": 18, "failed": 2, "unfinished": 1 }));
        assert_eq!(json["rows"][0]["literature"], "3DGS_2023");
        assert!(json["rows"][0].get("variant").is_none());
        let row = &json["rows"][2];
        assert_eq!((&row["variant"], &row["labels"]["method"]), (&json!("full"), &json!("full")));
        assert_eq!(
            row["entries"][0],
            json!({
                "column": "Mean",
                "metric": "composed.psnr",
                "state": "known",
                "mean": 29.0,
                "deviation": 1.0,
                "seeds": [{ "seed": 0, "mean": 28.0 }, { "seed": 1, "mean": 29.0 }, { "seed": 2, "mean": 30.0 }],
                "best": false,
                "paper": 32.07,
                "difference": 29.0 - 32.07,
                "comparable": false,
                "not_comparable": ["built-in scene", "train.scale = 0.3"],
            })
        );
        assert_eq!(json["rows"][3]["entries"][0]["mean"], json!(null));
    }

    #[test]
    fn swept_values_keep_their_kind() {
        let (index, outcomes) = windows();
        let json = serde_json::to_value(Table::of(&index, &outcomes).json()).expect("written");
        assert_eq!(json["rows"][0]["values"], json!({ "motion.kind": "global", "motion.window": 9 }));
        assert_eq!(json["columns"][0]["better"], "higher");
        assert_eq!(json["columns"][1]["scenes"], json!(["video"]));
    }
}
