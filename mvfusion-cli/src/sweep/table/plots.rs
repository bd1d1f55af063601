//! Which curves a table has: each metric over each swept key whose values are numbers.

use mvfusion_model::Config;

use super::paper::spoken;
use super::{Column, Method, Row, Spread, Table, paper};
use crate::sweep::grid::number;
use crate::sweep::metric::{self, TableMetric};

/// A value of the swept key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The value.
    pub x: f64,
    /// Our metric.
    pub spread: Option<Spread>,
    /// The paper's.
    pub paper: Option<f64>,
    /// Whether the two say something about each other.
    pub is_comparable: bool,
}

/// A line.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// What it shows, for the legend.
    pub name: String,
    /// Its points, by value.
    pub points: Vec<Point>,
}

/// A metric over a swept key.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Name of its file.
    pub file: String,
    /// Heading.
    pub title: String,
    /// The key.
    pub x_title: String,
    /// The metric.
    pub y_title: String,
    /// The lines.
    pub series: Vec<Series>,
}

impl Series {
    /// Whether there is anything to draw.
    pub fn has_points(&self) -> bool {
        self.points.iter().any(|point| point.spread.is_some() || point.paper.is_some())
    }

    /// The points of which the paper has numbers.
    pub fn papers(&self) -> impl Iterator<Item = &Point> {
        self.points.iter().filter(|point| point.paper.is_some())
    }
}

/// The curves of a table, by key and metric; those without a point are left out.
pub(super) fn of(table: &Table) -> Vec<Plot> {
    let mut metrics: Vec<&TableMetric> = Vec::new();
    for column in &table.columns {
        if !metrics.iter().any(|metric| metric.name == column.metric.name) {
            metrics.push(&column.metric);
        }
    }
    let axes = (0..table.axes.len()).filter(|&axis| is_numeric(table, axis));
    let plots = axes.flat_map(|axis| metrics.iter().map(move |metric| plot(table, axis, metric)));
    plots.filter(|plot| !plot.series.is_empty()).collect()
}

/// The rows that were trained, with variant and values.
fn trained(table: &Table) -> impl Iterator<Item = (&Row, &str, &[String])> {
    table.rows.iter().filter_map(|row| match &row.method {
        Method::Trained { variant, values } => Some((row, variant.as_str(), values.as_slice())),
        Method::Difference { .. } | Method::Literature(_) => None,
    })
}

fn value(values: &[String], axis: usize) -> Option<f64> {
    number(&paper::parsed(values.get(axis)?)).filter(|value| value.is_finite())
}

/// Whether all values of a key are numbers, and not all the same.
fn is_numeric(table: &Table, axis: usize) -> bool {
    let numbers: Option<Vec<f64>> = trained(table).map(|(_, _, values)| value(values, axis)).collect();
    numbers.is_some_and(|numbers| numbers.iter().any(|number| *number != numbers[0]))
}

fn plot(table: &Table, axis: usize, metric: &TableMetric) -> Plot {
    let key = &table.axes[axis];
    let mut lines: Vec<(Line, Series)> = Vec::new();
    for (place, column) in table.columns.iter().enumerate().filter(|(_, column)| column.metric.name == metric.name) {
        for (row, variant, values) in trained(table) {
            let Some(x) = value(values, axis) else { continue };
            let entry = &row.entries[place];
            let is_comparable = entry.not_comparable.is_empty();
            let point = Point { x, spread: entry.spread, paper: entry.paper, is_comparable };
            let line = Line { place, variant, others: others(values, axis) };
            match lines.iter_mut().find(|(other, _)| *other == line) {
                Some((_, series)) => series.points.push(point),
                None => {
                    let name = name(table, column, &line, axis);
                    lines.push((line, Series { name, points: vec![point] }));
                }
            }
        }
    }
    let series = lines.into_iter().map(|(_, series)| series).filter(Series::has_points);
    let sorted = series.map(|mut series| {
        series.points.sort_by(|a, b| a.x.total_cmp(&b.x));
        series
    });
    Plot {
        file: file_name(key, &metric.name),
        title: table.title.clone(),
        x_title: key.clone(),
        y_title: metric.heading(),
        series: sorted.collect(),
    }
}

/// What the points of a line have in common.
#[derive(PartialEq)]
struct Line<'a> {
    place: usize,
    variant: &'a str,
    others: Vec<(usize, &'a str)>,
}

/// The values of the other keys.
fn others(values: &[String], axis: usize) -> Vec<(usize, &str)> {
    values.iter().map(String::as_str).enumerate().filter(|(place, _)| *place != axis).collect()
}

/// What tells a line from the others: column group, variant and the other keys, each where there are several.
fn name(table: &Table, column: &Column, line: &Line, axis: usize) -> String {
    let groups = table.columns.iter().filter(|other| other.metric.name == column.metric.name);
    let has_variants = trained(table).any(|(_, variant, _)| variant != line.variant);
    let differs =
        |place: usize, value: &str| trained(table).any(|(_, _, values)| values.get(place).is_some_and(|v| v != value));
    let group = (groups.count() > 1).then(|| column.group.clone());
    let variant = has_variants.then(|| line.variant.to_owned()).filter(|variant| !variant.is_empty());
    let others = line.others.iter().filter(|(place, value)| *place != axis && differs(*place, value));
    let others = others.filter_map(|(place, value)| Some(format!("{} = {}", table.axes.get(*place)?, spoken(value))));
    let parts: Vec<String> = group.into_iter().chain(variant).chain(others).collect();
    if parts.is_empty() { column.group.clone() } else { parts.join(", ") }
}

/// Name of the file of a key and a metric.
fn file_name(key: &str, metric: &str) -> String {
    format!("{}_{}.svg", file_part(key), file_part(metric))
}

/// Whether a file of this name can be a curve of an earlier table.
pub(super) fn is_curve(file: &str) -> bool {
    let keys = || Config::key_notes().iter();
    metric::all().iter().any(|metric| {
        file.ends_with(&file_name("", &metric.name)) && keys().any(|notes| file == file_name(&notes.key, &metric.name))
    })
}

/// A key or a metric's name as a part of a file's name.
fn file_part(name: &str) -> String {
    name.chars().map(|letter| if letter.is_ascii_alphanumeric() || letter == '_' { letter } else { '-' }).collect()
}

#[cfg(test)]
mod tests {
    use super::super::specimen::{cell, group, index, metrics, windows};
    use super::*;
    use crate::sweep::table::Outcome;

    #[test]
    fn a_line_has_means_spreads_and_the_papers_numbers_by_value() {
        let (index, outcomes) = windows();
        let plots = of(&Table::of(&index, &outcomes));
        let files: Vec<&str> = plots.iter().map(|plot| plot.file.as_str()).collect();
        assert_eq!(files, ["motion-window_composed-psnr.svg", "motion-window_composed-lpips_alex.svg"]);
        let [series] = plots[0].series.as_slice() else { panic!("{plots:?}") };
        assert_eq!(series.name, "Neu3D");
        let papers: Vec<_> = series.points.iter().map(|point| (point.x, point.paper)).collect();
        assert_eq!(papers, [(3.0, None), (5.0, Some(32.07)), (9.0, Some(31.9))]);
        let Some(Spread { mean, deviation: Some(deviation) }) = series.points[0].spread else { panic!("{series:?}") };
        assert!(mean == 30.125 && (deviation - 0.25 / 2f64.sqrt()).abs() < 1e-12, "{mean} {deviation}");
    }

    #[test]
    fn lines_are_told_apart_by_what_differs() {
        let columns = vec![group("A", &["a"], &["mask_iou"]), group("B", &["b"], &["mask_iou"])];
        let mut index = index(&["size", "same", "kind"], columns, "");
        for scene in ["a", "b"] {
            for (variant, size, kind) in
                [("x", "1", "'p'"), ("x", "2.5", "'p'"), ("y", "1", "'p'"), ("y", "1", "'q'"), ("y", "2.5", "'q'")]
            {
                index.cells.push(cell(scene, variant, &[size, "4", kind], 0));
            }
        }
        let outcomes = vec![metrics(&[("mask_iou", 0.5)]); index.cells.len()];
        let plots = of(&Table::of(&index, &outcomes));
        assert_eq!(plots.len(), 1, "neither `same` nor `kind` is an axis");
        let names: Vec<_> = plots[0].series.iter().map(|series| (series.name.as_str(), series.points.len())).collect();
        let expected = [("x, kind = p", 2), ("y, kind = p", 1), ("y, kind = q", 2)];
        let [a, b] = ["A", "B"].map(|group| expected.map(|(name, points)| (format!("{group}, {name}"), points)));
        assert_eq!(names, a.iter().chain(&b).map(|(name, points)| (name.as_str(), *points)).collect::<Vec<_>>());
    }

    #[test]
    fn what_has_no_numbers_has_no_curves() {
        let (mut index, _) = windows();
        assert_eq!(of(&Table::of(&index, &[Outcome::Failed])).len(), 1, "the paper's numbers alone");
        index.paper.clear();
        assert!(of(&Table::of(&index, &[])).is_empty());
        index.cells[0].values[0] = "'five'".into();
        assert!(of(&Table::of(&index, &[metrics(&[("composed.psnr", 1.0)])])).is_empty());
    }

    #[test]
    fn a_curve_is_known_by_its_key_and_its_metric() {
        assert!(is_curve("motion-window_composed-psnr.svg") && is_curve("train-scale_movers-lpips_alex.svg"));
        for other in
            ["figure.svg", "mine_composed-psnr.svg", "motion-window_mine.svg", "motion-window_composed-psnr.png"]
        {
            assert!(!is_curve(other), "{other}");
        }
    }

    #[test]
    fn names_of_files_stay_in_their_folder() {
        assert_eq!(file_part("motion.window"), "motion-window");
        assert_eq!(file_part("../a b\\c"), "---a-b-c");
    }
}
