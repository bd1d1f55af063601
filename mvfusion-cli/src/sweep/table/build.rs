//! From what the cells yielded to the means and spreads of the table.

use mvfusion_model::evaluation::Better;

use super::paper::spoken;
use super::{
    CellCounts, Column, Entry, Method, Outcome, Row, SeedMean, Spread, State, Table, TrainedCell, origins, paper,
    regions, verdict,
};
use crate::sweep::grid::Difference;
use crate::sweep::index::Index;
use crate::sweep::metric::TableMetric;

/// How rows are called that have a heading for their method, but no variant.
const OURS: &str = "ours";

impl Table {
    /// The table of a sweep; `outcomes` are in the order of the index's cells, and cells beyond them are not finished.
    pub fn of(index: &Index, outcomes: &[Outcome]) -> Self {
        let outcomes = outcomes.iter().chain(std::iter::repeat(&Outcome::Unfinished));
        let cells: Vec<TrainedCell> = index.cells.iter().zip(outcomes).collect();
        let seeds = distinct(index.cells.iter().map(|cell| cell.seed));
        let mut columns = columns(index);
        let regions = regions::sources(&columns, &cells);
        let labels = Labels::of(index);
        let mut rows = literature(index, &columns, &labels);
        rows.extend(trained(index, &columns, &labels, &seeds, &cells));
        for (place, column) in columns.iter_mut().enumerate() {
            column.paper_decimals = paper_decimals(&rows, place, &column.metric);
            mark_best(&mut rows, place, &column.metric);
        }
        rows.extend(differences(index, &rows, &labels));
        let verdicts = index.rule.iter().flat_map(|rule| verdict::of(rule, &rows, &columns, &cells)).collect();
        Self {
            name: index.name.clone(),
            title: index.title.clone(),
            about: index.about.clone(),
            axes: index.axes.clone(),
            seeds,
            headings: labels.headings(&index.axes),
            columns,
            rows,
            rule: index.rule.clone(),
            verdicts,
            wanted: index.wanted.clone(),
            regions,
            mixtures: origins::mixtures(&cells),
            amendments: index.amendments.clone(),
            cells: counts(&cells),
        }
    }
}

impl Entry {
    /// With the paper's number, and the reason against comparing it if its row gives one.
    fn with_paper(mut self, number: Option<paper::Number<'_>>) -> Self {
        self.paper = number.map(|number| number.value);
        self.not_comparable.extend(number.and_then(|number| number.not_comparable).map(str::to_owned));
        self
    }

    /// The differences to another entry, of the seeds that both have.
    fn minus(&self, other: &Self) -> Self {
        let difference = |own: &SeedMean| {
            let other = other.seeds.iter().find(|other| other.seed == own.seed)?;
            Some(SeedMean { seed: own.seed, mean: own.mean - other.mean })
        };
        let seeds: Vec<SeedMean> = self.seeds.iter().filter_map(difference).collect();
        let spread = spread(&seeds.iter().map(|seed| seed.mean).collect::<Vec<_>>());
        let missing = match (self.state, other.state) {
            // Each knows seeds that the other lacks.
            (State::Known, State::Known) => State::Unfinished,
            (State::Known, missing) | (missing, _) => missing,
        };
        let reasons = self.not_comparable.iter().chain(&other.not_comparable).cloned();
        Self {
            state: if spread.is_some() { State::Known } else { missing },
            seeds,
            spread,
            paper: self.paper.zip(other.paper).map(|(own, other)| own - other),
            not_comparable: distinct(reasons),
            is_best: false,
            is_difference: true,
        }
    }
}

/// A row for each method that is not trained here.
fn literature(index: &Index, columns: &[Column], labels: &Labels) -> Vec<Row> {
    let methods = paper::literature(&index.paper).into_iter();
    let row = |(name, at): (&str, &toml::Table)| {
        let number = |group: &str, metric: &str| paper::of_literature(&index.paper, (name, at), (group, metric));
        let entry = |column: &Column| Entry::default().with_paper(number(&column.group, &column.metric.name));
        let values: Vec<String> = index.axes.iter().map(|key| paper::at(at, key).unwrap_or_default()).collect();
        let method = Method::Literature(name.to_owned());
        Row { labels: labels.row(name, &values), method, entries: columns.iter().map(entry).collect() }
    };
    methods.map(row).collect()
}

/// A row for all cells that differ in scene and seed alone.
fn trained(index: &Index, columns: &[Column], labels: &Labels, seeds: &[u64], cells: &[TrainedCell]) -> Vec<Row> {
    let rows = distinct(index.cells.iter().map(|cell| (&cell.variant, &cell.values))).into_iter();
    let row = |(variant, values): (&String, &Vec<String>)| {
        let own = |(cell, _): &&TrainedCell| cell.variant == *variant && cell.values == *values;
        let own: Vec<TrainedCell> = cells.iter().filter(own).copied().collect();
        let place = (variant.as_str(), index.axes.as_slice(), values.as_slice());
        let number = |group: &str, metric: &str| paper::of_trained(&index.paper, place, (group, metric));
        let entry = |column: &Column| entry(column, &own, seeds).with_paper(number(&column.group, &column.metric.name));
        let name = if variant.is_empty() { OURS } else { variant };
        let method = Method::Trained { variant: variant.clone(), values: values.clone() };
        Row { labels: labels.row(name, values), method, entries: columns.iter().map(entry).collect() }
    };
    rows.map(row).collect()
}

/// A row for each difference that the grid asks for, at all values of the swept keys that both variants have.
fn differences(index: &Index, rows: &[Row], labels: &Labels) -> Vec<Row> {
    let mut differences = Vec::new();
    for Difference { variant, minus } in &index.differences {
        for (values, first) in rows_of(rows, variant) {
            let Some((_, second)) = rows_of(rows, minus).find(|(others, _)| *others == values) else { continue };
            let entries = first.entries.iter().zip(&second.entries);
            differences.push(Row {
                labels: labels.row(&format!("{variant} - {minus}"), values),
                method: Method::Difference { variant: variant.clone(), minus: minus.clone(), values: values.to_vec() },
                entries: entries.map(|(first, second)| first.minus(second)).collect(),
            });
        }
    }
    differences
}

/// The rows of a variant that was trained, with their values of the swept keys.
fn rows_of<'a>(rows: &'a [Row], name: &str) -> impl Iterator<Item = (&'a [String], &'a Row)> {
    rows.iter().filter_map(move |row| match &row.method {
        Method::Trained { variant, values } if variant == name => Some((values.as_slice(), row)),
        _ => None,
    })
}

/// The different items in the order in which they first come.
fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut distinct = Vec::new();
    for item in items {
        if !distinct.contains(&item) {
            distinct.push(item);
        }
    }
    distinct
}

fn columns(index: &Index) -> Vec<Column> {
    let all = distinct(index.cells.iter().map(|cell| cell.scene.clone()));
    let groups = index.columns.iter().enumerate();
    groups
        .flat_map(|(group_index, group)| {
            let scenes = if group.scenes.is_empty() { &all } else { &group.scenes };
            group.metrics.iter().map(move |name| Column {
                group: group.title.clone(),
                group_index,
                scenes: scenes.clone(),
                metric: TableMetric::of(name),
                paper_decimals: None,
            })
        })
        .collect()
}

/// Which labels tell the rows apart.
struct Labels {
    /// Heading of the variant's or method's name.
    method: Option<&'static str>,
    /// Places of the swept keys.
    axes: Vec<usize>,
}

impl Labels {
    fn of(index: &Index) -> Self {
        let differs = |place: &usize| distinct(index.cells.iter().map(|cell| cell.values.get(*place))).len() > 1;
        let axes: Vec<usize> = (0..index.axes.len()).filter(differs).collect();
        let variants = distinct(index.cells.iter().map(|cell| cell.variant.as_str()));
        let is_alone = axes.is_empty() && variants.iter().any(|variant| !variant.is_empty());
        let method = if !paper::literature(&index.paper).is_empty() {
            Some("method")
        } else {
            (variants.len() > 1 || is_alone).then_some("variant")
        };
        Self { method, axes }
    }

    fn headings(&self, axes: &[String]) -> Vec<String> {
        let method = self.method.map(str::to_owned);
        method.into_iter().chain(self.axes.iter().map(|place| axes[*place].clone())).collect()
    }

    fn row(&self, method: &str, values: &[String]) -> Vec<String> {
        let method = self.method.map(|_| method.to_owned());
        let value = |place: &usize| values.get(*place).map_or(String::new(), |value| spoken(value));
        method.into_iter().chain(self.axes.iter().map(value)).collect()
    }
}

/// Our metric of a column for cells that differ in scene and seed alone.
fn entry(column: &Column, own: &[TrainedCell], seeds: &[u64]) -> Entry {
    let own: Vec<TrainedCell> = own.iter().filter(|(cell, _)| column.scenes.contains(&cell.scene)).copied().collect();
    let mean_of = |seed: &u64| {
        let of_scene = |scene: &String| {
            let (_, outcome) = own.iter().find(|(cell, _)| cell.seed == *seed && cell.scene == *scene)?;
            metric(outcome, &column.metric.name)
        };
        let metrics: Option<Vec<f64>> = column.scenes.iter().map(of_scene).collect();
        metrics.and_then(|metrics| mean(&metrics)).map(|mean| SeedMean { seed: *seed, mean })
    };
    let means: Vec<SeedMean> = seeds.iter().filter_map(mean_of).collect();
    let spread = spread(&means.iter().map(|seed| seed.mean).collect::<Vec<_>>());
    Entry {
        state: if spread.is_some() { State::Known } else { state(&own, &column.metric.name) },
        seeds: means,
        spread,
        paper: None,
        not_comparable: distinct(own.iter().filter_map(|(cell, _)| cell.not_comparable.clone())),
        is_best: false,
        is_difference: false,
    }
}

/// A metric of a cell; one that is no number is not known.
fn metric(outcome: &Outcome, name: &str) -> Option<f64> {
    match outcome {
        Outcome::Metrics(metrics) => metrics.numbers.get(name).copied().filter(|value| value.is_finite()),
        Outcome::Failed | Outcome::Unfinished => None,
    }
}

/// Why no seed has a metric.
fn state(own: &[TrainedCell], name: &str) -> State {
    let any = |is: &dyn Fn(&Outcome) -> bool| own.iter().any(|(_, outcome)| is(outcome));
    // What a finished cell does not know, those that failed would not have known either.
    if any(&|outcome| matches!(outcome, Outcome::Metrics(_)) && metric(outcome, name).is_none()) {
        State::Unknown
    } else if any(&|outcome| *outcome == Outcome::Failed) {
        State::Failed
    } else if any(&|outcome| *outcome == Outcome::Unfinished) {
        State::Unfinished
    } else {
        State::Unknown
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn spread(values: &[f64]) -> Option<Spread> {
    let mean = mean(values)?;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let deviation = (values.len() > 1).then(|| (squares / (values.len() - 1) as f64).sqrt());
    Some(Spread { mean, deviation })
}

/// As many decimals as the paper needs in a column, but no more than ours have: 0.943 is not shown as 0.9430.
fn paper_decimals(rows: &[Row], place: usize, metric: &TableMetric) -> Option<usize> {
    let decimals = |value: f64| value.to_string().split_once('.').map_or(0, |(_, decimals)| decimals.len());
    rows.iter().filter_map(|row| row.entries[place].paper).map(|value| decimals(value).min(metric.decimals)).max()
}

/// Marks the best entries of a column, if there is more than one to choose from. What looks the same is as good. A mean
/// over other seeds than those of the first row with the most does not compete: the seeds that it lacks may be the hard
/// ones.
fn mark_best(rows: &mut [Row], place: usize, metric: &TableMetric) {
    let seeds = |entry: &Entry| entry.seeds.iter().map(|seed| seed.seed).collect::<Vec<u64>>();
    let all = rows.iter().map(|row| seeds(&row.entries[place]));
    let most = all.rev().max_by_key(Vec::len).unwrap_or_default();
    let competes = |entry: &Entry| seeds(entry) == most;
    let competing = || rows.iter().map(|row| &row.entries[place]).filter(|entry| competes(entry));
    let means = || competing().filter_map(|entry| entry.spread.map(|spread| spread.mean));
    let best = match metric.better {
        Some(Better::Higher) => means().max_by(f64::total_cmp),
        Some(Better::Lower) => means().min_by(f64::total_cmp),
        None => None,
    };
    let Some(best) = best.filter(|_| means().count() > 1).map(|best| metric.shown(best)) else { return };
    for entry in rows.iter_mut().map(|row| &mut row.entries[place]) {
        entry.is_best = competes(entry) && entry.spread.is_some_and(|spread| metric.shown(spread.mean) == best);
    }
}

fn counts(cells: &[TrainedCell]) -> CellCounts {
    let count = |wanted: &Outcome| cells.iter().filter(|(_, outcome)| *outcome == wanted).count();
    CellCounts { total: cells.len(), failed: count(&Outcome::Failed), unfinished: count(&Outcome::Unfinished) }
}

#[cfg(test)]
#[path = "build_tests.rs"]
mod tests;
