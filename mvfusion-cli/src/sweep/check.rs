//! Checks of a grid before any of its cells is created.

use std::collections::{BTreeMap, BTreeSet};

use mvfusion_model::Config;
use toml::{Table, Value};

use super::grid::{ALL_METRICS, Axis, ColumnGroup, Difference, Expected, Grid, PaperRow, Rule, RuleScene, is_same};
use super::index::{Cell, Index};
use super::metric;
use crate::config::{self, PartialConfig, leaves, nearest};
use crate::failure::UsageError;

/// Keys that a grid sets in other places, and these places.
const ELSEWHERE: [(&str, &str); 4] = [
    ("seed", "list it in `seeds`"),
    ("scene.data", "use `data` of the scene"),
    ("eval.dynamic_masks", "use `masks` of the scene"),
    ("eval.lpips_weights", "use --lpips-weights on the command line"),
];

/// Checks lists, names and conflicting keys. `settings` are those of the command line.
pub(super) fn grid(grid: &Grid, axes: &[Axis], settings: &[PartialConfig], origin: &str) -> Result<(), UsageError> {
    let wrong = |what: String| UsageError::new(format!("{origin}: {what}"));
    lists(grid, axes).map_err(wrong)?;
    expected(grid.expected.as_ref()).map_err(wrong)?;
    presets(grid).map_err(wrong)?;
    keys(grid, axes, settings).map_err(wrong)?;
    exclusion_keys(grid, axes).map_err(wrong)?;
    columns(grid).map_err(wrong)?;
    differences(grid).map_err(wrong)?;
    rule(grid).map_err(wrong)?;
    grid.paper.iter().try_for_each(|row| paper(grid, axes, row)).map_err(wrong)?;
    paper_once(&grid.paper).map_err(wrong)
}

/// Rejects empty lists and repeated entries.
fn lists(grid: &Grid, axes: &[Axis]) -> Result<(), String> {
    let empty = |what: &str| Err(format!("{what} is empty, so there is nothing to train."));
    if grid.scenes.is_empty() {
        return empty("`scenes`");
    }
    if grid.seeds.is_empty() {
        return empty("`seeds`");
    }
    once("the scene", grid.scenes.iter().map(|scene| &scene.name))?;
    // `--scenes` takes several names, with commas between them.
    if let Some(scene) = grid.scenes.iter().find(|scene| scene.name.contains(',')) {
        return Err(format!("the name of the scene `{}` has a comma, which separates names in --scenes.", scene.name));
    }
    once("the variant", grid.variants.iter().map(|variant| &variant.name))?;
    once("the seed", grid.seeds.iter())?;
    for axis in axes {
        if axis.values.is_empty() {
            return empty(&format!("`{}` in [grid]", axis.key));
        }
        once(&format!("`{}` in [grid]: the value", axis.key), axis.values.iter())?;
    }
    match grid.variants.iter().position(|variant| variant.name.trim().is_empty()) {
        Some(place) => Err(format!("the name of variant {} is empty; its row needs a name.", place + 1)),
        None => Ok(()),
    }
}

/// Checks the time that a cell takes. JSON, in which it is kept, has no infinity.
fn expected(expected: Option<&Expected>) -> Result<(), String> {
    match expected {
        Some(Expected { minutes, .. }) if !(minutes.is_finite() && *minutes > 0.0) => {
            Err(format!("`minutes` in `expected` is {minutes}; give a finite number above 0."))
        }
        _ => Ok(()),
    }
}

/// Rejects repeated entries of a list.
fn once(what: &str, entries: impl Iterator<Item = impl ToString>) -> Result<(), String> {
    let mut seen = BTreeSet::new();
    match entries.map(|entry| entry.to_string()).find(|entry| !seen.insert(entry.clone())) {
        Some(entry) => Err(format!("{what} `{entry}` appears twice.")),
        None => Ok(()),
    }
}

/// Rejects grids in which both a scene and a variant name a preset.
fn presets(grid: &Grid) -> Result<(), String> {
    let scene = grid.scenes.iter().find(|scene| scene.preset.is_some());
    let variant = grid.variants.iter().find(|variant| variant.preset.is_some());
    match (scene, variant) {
        (Some(scene), Some(variant)) => Err(format!(
            "the scene `{}` and the variant `{}` both name a preset, but a cell starts from only one. Use keys under \
             `set` for one of them.",
            scene.name, variant.name
        )),
        _ => Ok(()),
    }
}

/// Rejects keys that are set in two places, or in the wrong place.
fn keys(grid: &Grid, axes: &[Axis], settings: &[PartialConfig]) -> Result<(), String> {
    let own = [("[set]".to_owned(), &grid.set), ("[grid]".to_owned(), &grid.grid)];
    let scenes: Vec<Place> =
        grid.scenes.iter().map(|scene| (format!("the scene `{}`", scene.name), &scene.set)).collect();
    let variants: Vec<Place> =
        grid.variants.iter().map(|variant| (format!("the variant `{}`", variant.name), &variant.set)).collect();
    let given: Vec<Place> = settings.iter().map(|layer| ("--set".to_owned(), &layer.table)).collect();
    for (place, table) in own.iter().chain(&scenes).chain(&variants).chain(&given) {
        for (key, _) in leaves(table) {
            if let Some((_, remedy)) = ELSEWHERE.iter().find(|(known, _)| *known == key) {
                return Err(format!("`{key}` cannot be set in {place}; {remedy}."));
            }
        }
    }
    for (index, axis) in axes.iter().enumerate() {
        if let Some(other) = axes[..index].iter().find(|other| overlap(&other.key, &axis.key)) {
            return Err(format!("`{}` and `{}` in [grid] set the same key.", other.key, axis.key));
        }
    }
    let swept = [("[grid]".to_owned(), &grid.grid)];
    let elsewhere: Vec<Place> = [&own[..1], &scenes, &variants, &given].concat();
    apart(&swept, &elsewhere)?;
    apart(&variants, &[&scenes[..], &given].concat())
}

/// Keys and the place where they are set.
type Place<'a> = (String, &'a Table);

/// Rejects keys that are set in a place of each kind.
fn apart(some: &[Place<'_>], others: &[Place<'_>]) -> Result<(), String> {
    for ((place, table), (other_place, other_table)) in some.iter().flat_map(|a| others.iter().map(move |b| (a, b))) {
        for (key, _) in leaves(table) {
            if let Some((other, _)) = leaves(other_table).into_iter().find(|(other, _)| overlap(&key, other)) {
                return Err(format!(
                    "`{key}` in {place} and `{other}` in {other_place} set the same key. Remove one of them."
                ));
            }
        }
    }
    Ok(())
}

/// Whether two dotted keys are equal, or one is a part of the other.
fn overlap(a: &str, b: &str) -> bool {
    let within = |inner: &str, outer: &str| inner.strip_prefix(outer).is_some_and(|rest| rest.starts_with('.'));
    a == b || within(a, b) || within(b, a)
}

fn exclusion_keys(grid: &Grid, axes: &[Axis]) -> Result<(), String> {
    let known: Vec<&str> =
        ["scene", "variant", "seed"].into_iter().chain(axes.iter().map(|a| a.key.as_str())).collect();
    for entry in &grid.exclude {
        if entry.is_empty() {
            return Err("an entry of `exclude` is empty and would exclude every cell.".to_owned());
        }
        if let Some((key, _)) = leaves(entry).into_iter().find(|(key, _)| !known.contains(&key.as_str())) {
            return Err(format!("`exclude` accepts {}, not `{key}`.", listed(&known)));
        }
    }
    Ok(())
}

fn columns(grid: &Grid) -> Result<(), String> {
    let scenes: Vec<&str> = grid.scenes.iter().map(|scene| scene.name.as_str()).collect();
    let known: BTreeSet<String> = metric::all().into_iter().map(|metric| metric.name).collect();
    once("the column", grid.columns.iter().map(|column| &column.title))?;
    for column in &grid.columns {
        let wrong = |what: String| Err(format!("the column `{}` {what}", column.title));
        if let Some(scene) = column.scenes.iter().find(|scene| !scenes.contains(&scene.as_str())) {
            return wrong(format!("names the unknown scene `{scene}`; the scenes are {}.", listed(&scenes)));
        }
        if column.metrics.is_empty() {
            return wrong("has no metrics.".to_owned());
        }
        once(&format!("the column `{}`: the scene", column.title), column.scenes.iter())?;
        once(&format!("the column `{}`: the metric", column.title), column.metrics.iter())?;
        if let Some(metric) = column.metrics.iter().find(|metric| !known.contains(*metric)) {
            let meant = nearest(metric, known.iter().map(String::as_str))
                .map_or(String::new(), |near| format!(" Did you mean `{near}`?"));
            return wrong(format!("names the unknown metric `{metric}`.{meant}"));
        }
        if grid.speed_frames == 0 && column.metrics.iter().any(|metric| metric.starts_with("speed.")) {
            return wrong("needs the frame rate, which is not measured because `speed_frames` is 0.".to_owned());
        }
    }
    Ok(())
}

/// Checks that differences name two variants of the grid.
fn differences(grid: &Grid) -> Result<(), String> {
    let variants: Vec<&str> = grid.variants.iter().map(|variant| variant.name.as_str()).collect();
    let name = |difference: &Difference| format!("{} - {}", difference.variant, difference.minus);
    once("the difference", grid.differences.iter().map(name))?;
    for difference in &grid.differences {
        let Difference { variant, minus } = difference;
        if let Some(unknown) = [variant, minus].into_iter().find(|name| !variants.contains(&name.as_str())) {
            return Err(format!(
                "`differences` names the unknown variant `{unknown}`; the variants are {}.",
                listed(&variants)
            ));
        }
        if variant == minus {
            return Err(format!("`differences` compares `{variant}` with itself."));
        }
    }
    Ok(())
}

/// Checks that a row of the paper belongs to a row and a column of the table.
fn paper(grid: &Grid, axes: &[Axis], row: &PaperRow) -> Result<(), String> {
    let name = name_of(row);
    let lost = |what: String| Err(format!("the paper's row `{name}` {what}."));
    let is_variant = |name: &String| grid.variants.iter().any(|variant| variant.name == *name);
    if let Some(variant) = row.variant.as_ref().filter(|variant| !is_variant(variant)) {
        return lost(format!("names the unknown variant `{variant}`"));
    }
    if row.variant.is_some() && row.literature.is_some() {
        return lost("has both a `variant` and a `literature`".to_owned());
    }
    if let Some((metric, value)) = row.values.iter().find(|(_, value)| !value.is_finite()) {
        return lost(format!("has {value} for `{metric}`; give a finite number"));
    }
    let at = leaves(&row.at);
    let is_swept = |key: &str, value: &Value| {
        axes.iter().any(|axis| axis.key == key && axis.values.iter().any(|own| is_same(own, value)))
    };
    if let Some((key, value)) = at.iter().find(|(key, value)| !is_swept(key, value)) {
        return lost(format!("is at `{key} = {value}`, which is not in [grid]"));
    }
    let left_out = |axis: &&Axis| axis.values.len() > 1 && !at.iter().any(|(key, _)| *key == axis.key);
    if let Some(axis) = axes.iter().find(left_out).filter(|_| row.literature.is_none()) {
        return lost(format!("does not say to which `{}` it belongs; give `at`", axis.key));
    }
    let columns = grid.column_groups();
    match columns.iter().find(|column| column.title == row.column) {
        None => {
            let titles: Vec<&str> = columns.iter().map(|column| column.title.as_str()).collect();
            lost(format!("names the unknown column `{}`; the columns are {}", row.column, listed(&titles)))
        }
        Some(column) => match row.values.keys().find(|metric| !column.metrics.contains(metric)) {
            Some(metric) => lost(format!("has `{metric}`, which the column `{}` does not show", column.title)),
            None => reasons(row).or_else(lost),
        },
    }
}

/// The name of a row of the paper in messages.
fn name_of(row: &PaperRow) -> &str {
    row.variant.as_deref().or(row.literature.as_deref()).unwrap_or(&row.column)
}

/// Checks that a rule can judge: there are differences, and columns with the metrics of each of its scenes alone.
fn rule(grid: &Grid) -> Result<(), String> {
    let Some(Rule { confidence, least_helped, scenes }) = &grid.rule else { return Ok(()) };
    if grid.differences.is_empty() {
        return Err("`rule` judges the differences, and there are none.".to_owned());
    }
    if !(*confidence > 0.0 && *confidence < 1.0) {
        return Err(format!("`confidence` in `rule` is {confidence}; give a number between 0 and 1, such as 0.95."));
    }
    if !(1..=scenes.len()).contains(least_helped) {
        let count = scenes.len();
        return Err(format!(
            "`least_helped` in `rule` is {least_helped}; give a number from 1 to {count}, its scenes."
        ));
    }
    once("the scene in `rule`", scenes.iter().map(|scene| &scene.scene))?;
    let columns = grid.column_groups();
    for RuleScene { scene, metrics } in scenes {
        if metrics.is_empty() {
            return Err(format!("`rule` has no metrics of the scene `{scene}`."));
        }
        let shown = |name: &String| {
            columns.iter().any(|column| column.scenes == [scene.clone()] && column.metrics.contains(name))
        };
        if let Some(missing) = metrics.iter().find(|name| !shown(name)) {
            return Err(format!("`rule` needs `{missing}` in a column of the scene `{scene}` alone."));
        }
        if let Some(neutral) = metrics.iter().find(|name| metric::TableMetric::of(name).better.is_none()) {
            return Err(format!(
                "`rule` has `{neutral}` of the scene `{scene}`, which is better neither high nor low."
            ));
        }
    }
    Ok(())
}

/// Checks that the reasons of a row are not empty, and belong to values of the row.
fn reasons(row: &PaperRow) -> Result<(), String> {
    for (metric, reason) in &row.not_comparable {
        if metric != ALL_METRICS && !row.values.contains_key(metric) {
            return Err(format!(
                "has `{metric}` in `not_comparable`, but not in `values`; `{ALL_METRICS}` stands for all of its metrics"
            ));
        }
        if reason.trim_matches(['.', ' ']).is_empty() {
            return Err(format!("does not say why `{metric}` is not comparable"));
        }
    }
    Ok(())
}

/// Rejects a second value of the paper for the same entry of the table.
fn paper_once(rows: &[PaperRow]) -> Result<(), String> {
    for (index, row) in rows.iter().enumerate() {
        for other in rows[..index].iter().filter(|other| share_a_row(other, row)) {
            if let Some(metric) = row.values.keys().find(|metric| other.values.contains_key(*metric)) {
                return Err(format!(
                    "the paper has two values of `{metric}` for the same row in the column `{}`, in its rows `{}` and \
                     `{}`. Remove one of them.",
                    row.column,
                    name_of(other),
                    name_of(row)
                ));
            }
        }
    }
    Ok(())
}

/// Whether two rows of the paper belong to the same columns and the same row of the table.
fn share_a_row(a: &PaperRow, b: &PaperRow) -> bool {
    let [at, other] = [a, b].map(|row| leaves(&row.at));
    let agree = at.iter().all(|(key, value)| {
        let others = other.iter().find(|(other, _)| other == key);
        others.is_none_or(|(_, others)| is_same(value, others))
    });
    let is_one_method = match (&a.literature, &b.literature) {
        // Such a row belongs only to the values that it names, not to every value of a missing key.
        (Some(a), Some(b)) => a == b && at.len() == other.len() && at.iter().all(|(key, _)| has(&other, key)),
        (None, None) => a.variant.is_none() || b.variant.is_none() || a.variant == b.variant,
        _ => false,
    };
    a.column == b.column && is_one_method && agree
}

/// Whether a key is among the leaves of a table.
fn has(leaves: &[(String, &Value)], key: &str) -> bool {
    leaves.iter().any(|(own, _)| own == key)
}

/// Rejects exclusions that match nothing, or everything.
pub(super) fn exclusions(grid: &Grid, counts: &[usize], left: usize, origin: &str) -> Result<(), UsageError> {
    if let Some((entry, _)) = grid.exclude.iter().zip(counts).find(|(_, count)| **count == 0) {
        let entry = entry.to_string().trim_end().replace('\n', ", ");
        return Err(UsageError::new(format!("{origin}: no cell matches this entry of `exclude`: {entry}.")));
    }
    match left {
        0 => Err(UsageError::new(format!("{origin}: `exclude` excludes every cell."))),
        _ => Ok(()),
    }
}

/// Rejects two cells that are the same run, even if only after applying `train.scale`.
pub(super) fn twins(index: &Index, configs: &[Config]) -> anyhow::Result<()> {
    let mut seen: BTreeMap<String, &Cell> = BTreeMap::new();
    for (cell, config) in index.cells.iter().zip(configs) {
        let mut trained = config.scaled();
        // Like the id of a cell, what is learned does not depend on it.
        trained.train.tensorboard = false;
        if let Some(other) = seen.insert(config::to_toml(&trained)?, cell) {
            let [a, b] = [other, cell].map(|cell| cell.name(&index.axes));
            let why = if other.id == cell.id {
                "have the same configuration".to_owned()
            } else {
                format!("train identically at train.scale = {}", config.train.scale)
            };
            let message = format!("two cells of the grid are the same run: `{a}` and `{b}` {why}. Remove one of them.");
            return Err(UsageError::new(message).into());
        }
    }
    Ok(())
}

/// Rejects columns with metrics that the evaluation of their cells does not compute.
pub(super) fn scored(index: &Index, configs: &[Config]) -> Result<(), UsageError> {
    let wants_training_views =
        |column: &&ColumnGroup| column.metrics.iter().any(|name| name.starts_with(metric::TRAINING_VIEWS));
    for column in index.columns.iter().filter(wants_training_views) {
        let own = index.cells.iter().zip(configs).filter(|(cell, _)| column.scenes.contains(&cell.scene));
        if let Some((cell, _)) = own.into_iter().find(|(_, config)| !config.eval.training_views) {
            return Err(UsageError::new(format!(
                "the column `{}` needs metrics of the training views, which are not evaluated. Set \
                 eval.training_views = true for the scene `{}`.",
                column.title, cell.scene
            )));
        }
    }
    Ok(())
}

fn listed(names: &[&str]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests;
