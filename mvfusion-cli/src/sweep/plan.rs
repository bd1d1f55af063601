//! From a grid to its cells. Every configuration is resolved and checked before anything runs.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use mvfusion_model::Config;
use mvfusion_model::config::TrainConfig;
use mvfusion_model::files::sha256;
use toml::{Table, Value};

use super::check;
use super::grid::{Axis, Grid, SceneEntry, Source, VariantEntry, is_same};
use super::index::{Cell, Index, Wanted};
use crate::config::{self, Origin, PRESETS, PartialConfig, Preset, leaves};
use crate::failure::UsageError;

/// Cells of a grid at most. They are all resolved and checked before anything runs.
const MOST_CELLS: usize = 100_000;

/// Digits of a cell's id. Among a million cells, the probability of a collision is below 1/500.
const ID_LENGTH: usize = 12;

/// The preset whose runs have an eighth of the paper's length.
const SHORT: &str = "quickstart";

/// Keys of `train` that change only the output, not the training.
const UNSCHEDULED: [&str; 6] = [
    "train.log_interval",
    "train.tensorboard",
    "train.checkpoint_interval",
    "train.checkpoint_minutes",
    "train.keep_checkpoints",
    "train.on_bad_step",
];

/// What the command line adds to a grid.
#[derive(Clone, Debug, Default)]
pub struct Additions {
    /// Folder that contains the scene folders.
    pub data_root: Option<PathBuf>,
    /// Folder with the LPIPS weights.
    pub lpips_weights: Option<PathBuf>,
    /// Keys of every cell, as `KEY=VALUE`.
    pub set: Vec<String>,
}

/// A grid with all of its cells.
#[derive(Clone, Debug)]
pub struct Plan {
    /// For `sweep.json`.
    pub index: Index,
    /// The configurations, in the order of the cells.
    pub configs: Vec<Config>,
}

/// The position of a cell in its grid.
#[derive(Clone, Copy)]
struct Place<'a> {
    scene: &'a SceneEntry,
    variant: &'a VariantEntry,
    /// A value for each axis.
    values: &'a [Value],
    seed: u64,
}

/// The data that all cells of a grid share.
struct Ground<'a> {
    grid: &'a Grid,
    /// The grid's name, for messages.
    origin: &'a str,
    axes: &'a [Axis],
    additions: &'a Additions,
    /// The settings of the command line.
    settings: &'a [PartialConfig],
}

impl Plan {
    /// All cells of a grid.
    ///
    /// # Errors
    /// [`UsageError`] for a grid that contradicts itself, contains unknown names, or has a cell that cannot be trained.
    pub fn new(source: &Source, additions: &Additions) -> anyhow::Result<Self> {
        let grid = &source.grid;
        let axes = grid.axes()?;
        let settings: Vec<PartialConfig> =
            additions.set.iter().map(|setting| PartialConfig::from_setting(setting)).collect::<Result<_, _>>()?;
        check::grid(grid, &axes, &settings, &source.origin)?;
        let ground = Ground { grid, origin: &source.origin, axes: &axes, additions, settings: &settings };
        let nameless = [VariantEntry::default()];
        let variants = if grid.variants.is_empty() { &nameless[..] } else { &grid.variants };
        check_count(&axes, [grid.seeds.len(), grid.scenes.len(), variants.len()], &source.origin)?;
        let combinations = combinations(&axes);
        let mut excluded = vec![0; grid.exclude.len()];
        let (mut cells, mut configs) = (Vec::new(), Vec::new());
        for &seed in &grid.seeds {
            for scene in &grid.scenes {
                for variant in variants {
                    for values in &combinations {
                        let place = Place { scene, variant, values, seed };
                        if ground.is_excluded(place, &mut excluded) {
                            continue;
                        }
                        let (cell, config) = ground.cell(place)?;
                        cells.push(cell);
                        configs.push(config);
                    }
                }
            }
        }
        check::exclusions(grid, &excluded, cells.len(), &source.origin)?;
        let columns = grid.column_groups();
        let index = Index {
            name: source.name.clone(),
            title: grid.title.clone(),
            about: grid.about.trim().to_owned(),
            axes: axes.iter().map(|axis| axis.key.clone()).collect(),
            grid_sha256: Some(sha256(source.text.as_bytes())),
            wanted: Wanted::new(grid.speed_frames, additions.lpips_weights.as_deref(), &columns)?,
            columns,
            differences: grid.differences.clone(),
            rule: grid.rule.clone(),
            paper: grid.paper.clone(),
            amendments: Vec::new(),
            expected: grid.expected.clone(),
            cells,
        };
        check::twins(&index, &configs)?;
        check::scored(&index, &configs)?;
        Ok(Self { index, configs })
    }
}

impl Ground<'_> {
    /// Whether an entry of `exclude` matches a cell. Counts the matches of each entry.
    fn is_excluded(&self, place: Place<'_>, counts: &mut [usize]) -> bool {
        let mut any = false;
        for (entry, count) in self.grid.exclude.iter().zip(counts) {
            let is_own =
                |(key, value): &(String, &Value)| self.value(place, key).is_some_and(|own| is_same(&own, value));
            let agrees = leaves(entry).iter().all(is_own);
            *count += usize::from(agrees);
            any |= agrees;
        }
        any
    }

    /// The value of a cell at a key of an exclusion.
    fn value(&self, place: Place<'_>, key: &str) -> Option<Value> {
        match key {
            "scene" => Some(Value::String(place.scene.name.clone())),
            "variant" => Some(Value::String(place.variant.name.clone())),
            "seed" => i64::try_from(place.seed).ok().map(Value::Integer),
            _ => self.axes.iter().zip(place.values).find(|(axis, _)| axis.key == key).map(|(_, value)| value.clone()),
        }
    }

    fn cell(&self, place: Place<'_>) -> anyhow::Result<(Cell, Config)> {
        let preset = self.preset(place)?;
        let mut config = config::resolve_over(preset, self.partials(place)?)?;
        let cell = Cell {
            id: self.id(place, &config)?,
            scene: place.scene.name.clone(),
            variant: place.variant.name.clone(),
            values: place.values.iter().map(Value::to_string).collect(),
            seed: place.seed,
            preset: preset.name.to_owned(),
            steps: config.scaled().train.stages.total(),
            not_comparable: self.not_comparable(place, preset),
        };
        let root = self.additions.data_root.as_deref().unwrap_or(Path::new("."));
        config.scene.data = place.scene.data.as_ref().map(|folder| root.join(folder));
        config.eval.dynamic_masks = place.scene.masks.as_ref().map(|folder| root.join(folder));
        config.eval.lpips_weights.clone_from(&self.additions.lpips_weights);
        config::make_absolute(&mut config)?;
        Ok((cell, config))
    }

    /// The id of a cell. It does not depend on absolute paths, so that a sweep can move to another machine. Nor does it
    /// depend on the LPIPS weights, which may be added later, or on the event files for TensorBoard.
    fn id(&self, place: Place<'_>, config: &Config) -> anyhow::Result<String> {
        let mut config = config.clone();
        config.scene.data.clone_from(&place.scene.data);
        config.scene.frame_store = None;
        config.eval.dynamic_masks.clone_from(&place.scene.masks);
        config.train.tensorboard = false;
        // Sweeps that were started before these keys existed keep their cells.
        let mut text = config::to_toml(&config)?;
        for later in ["tensorboard = false\n", "normalisation = \"moments\"\n", "activation = \"relu\"\n"] {
            text = text.replace(later, "");
        }
        Ok(sha256(text.as_bytes())[..ID_LENGTH].to_owned())
    }

    /// The preset of the variant, otherwise of the scene, otherwise of the grid. [`check::grid`] rejects grids in which
    /// both a scene and a variant name one.
    fn preset(&self, place: Place<'_>) -> Result<&'static Preset, UsageError> {
        let named = place.variant.preset.as_deref().or(place.scene.preset.as_deref());
        Preset::find(named.unwrap_or(&self.grid.preset))
    }

    /// The layers above the preset. Later items override earlier ones.
    fn partials(&self, place: Place<'_>) -> Result<Vec<PartialConfig>, UsageError> {
        let origin = self.origin;
        let part = |part: String| Origin::Grid(format!("{origin}, {part}"));
        let mut partials = vec![
            PartialConfig::of_table(self.grid.set.clone(), part("[set]".to_owned())),
            PartialConfig::of_table(place.scene.set.clone(), part(format!("the scene `{}`", place.scene.name))),
            PartialConfig::of_table(place.variant.set.clone(), part(format!("the variant `{}`", place.variant.name))),
        ];
        for (axis, value) in self.axes.iter().zip(place.values) {
            partials.push(PartialConfig::of_one(&axis.key, value.clone(), part("[grid]".to_owned())));
        }
        partials.extend(self.settings.iter().cloned());
        let seed = i64::try_from(place.seed).map_err(|_| {
            UsageError::new(format!("{origin}: the seed {} is too large; the maximum is {}.", place.seed, i64::MAX))
        })?;
        partials.push(PartialConfig::of_one("seed", Value::Integer(seed), part("seeds".to_owned())));
        Ok(partials)
    }

    /// Why the paper's values are not comparable: another scene, or another schedule. The options with which a grid
    /// reads its scenes count as a part of the scenes; those of the command line do not. The changes of a variant are
    /// what the paper compares, except for a schedule of its own.
    fn not_comparable(&self, place: Place<'_>, preset: &'static Preset) -> Option<String> {
        let mut reasons = BTreeSet::new();
        if place.scene.data.is_none() {
            reasons.insert("built-in scene".to_owned());
        }
        if preset.lineage().iter().any(|base| base.name == SHORT) {
            reasons.insert(format!("preset {}", preset.name));
        }
        let mut add = |table: &Table, is_part_of_scene: fn(&str) -> bool| {
            let is_output = |key: &str| key.starts_with("eval.") || UNSCHEDULED.contains(&key);
            let counts = |key: &str| !is_output(key) && !is_part_of_scene(key);
            let given = leaves(table).into_iter().filter(|(key, _)| counts(key));
            reasons.extend(given.map(|(key, value)| format!("{key} = {value}")));
        };
        for table in [&self.grid.set, &place.scene.set] {
            add(table, |key| key.starts_with("scene."));
        }
        for layer in self.settings {
            add(&layer.table, |_| false);
        }
        reasons.extend(self.own_schedule(place.variant, preset));
        // A swept key that the paper does not sweep.
        let is_the_papers =
            |key: &str| self.grid.paper.iter().any(|row| leaves(&row.at).iter().any(|(at, _)| at == key));
        let others = self.axes.iter().zip(place.values).filter(|(axis, _)| !is_the_papers(&axis.key));
        reasons.extend(others.map(|(axis, value)| format!("{} = {value}", axis.key)));
        (!reasons.is_empty()).then(|| reasons.into_iter().collect::<Vec<_>>().join(", "))
    }

    /// The keys of a variant's schedule, if it is neither that of the preset nor that of a method that ships as a
    /// preset `PRESET-...`. If the scenes name the presets, a variant cannot, and sets the keys of the method itself.
    fn own_schedule(&self, variant: &VariantEntry, preset: &'static Preset) -> Vec<String> {
        let is_schedule = |key: &str| key.starts_with("train.") && !UNSCHEDULED.contains(&key);
        let given: Vec<String> = leaves(&variant.set)
            .into_iter()
            .filter(|(key, _)| is_schedule(key))
            .map(|(key, value)| format!("{key} = {value}"))
            .collect();
        if given.is_empty() {
            return given;
        }
        let schedule = |preset, partials| {
            let train = config::resolve_over(preset, partials).ok()?.train;
            let unscheduled = TrainConfig::default();
            Some(TrainConfig {
                log_interval: unscheduled.log_interval,
                tensorboard: unscheduled.tensorboard,
                checkpoint_interval: unscheduled.checkpoint_interval,
                checkpoint_minutes: unscheduled.checkpoint_minutes,
                keep_checkpoints: unscheduled.keep_checkpoints,
                on_bad_step: unscheduled.on_bad_step,
                ..train
            })
        };
        let origin = Origin::Grid(self.origin.to_owned());
        let own = schedule(preset, vec![PartialConfig::of_table(variant.set.clone(), origin)]);
        let is_relative =
            |name: &str| name.strip_prefix(preset.name).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'));
        let mut methods = PRESETS.iter().filter(|method| is_relative(method.name));
        let is_a_methods = own.is_some() && methods.any(|method| schedule(method, Vec::new()) == own);
        if is_a_methods { Vec::new() } else { given }
    }
}

/// Rejects more cells than can be planned, before any of them is made. Excluded ones count.
fn check_count(axes: &[Axis], lists: [usize; 3], origin: &str) -> Result<(), UsageError> {
    let mut lengths = axes.iter().map(|axis| axis.values.len()).chain(lists);
    let count = lengths.try_fold(1, |count: usize, length| count.checked_mul(length));
    match count.filter(|count| *count <= MOST_CELLS) {
        Some(_) => Ok(()),
        None => Err(UsageError::new(format!(
            "{origin}: the grid has more than {MOST_CELLS} cells: all seeds times scenes times variants times values \
             of [grid]. Shorten its lists, or split it."
        ))),
    }
}

/// Every combination of one value per axis. The last axis varies fastest. Without axes, there is one empty combination.
fn combinations(axes: &[Axis]) -> Vec<Vec<Value>> {
    axes.iter().fold(vec![Vec::new()], |combinations, axis| {
        let with = |combination: &Vec<Value>| {
            let combination = combination.clone();
            axis.values.iter().map(move |value| [combination.clone(), vec![value.clone()]].concat())
        };
        combinations.iter().flat_map(with).collect()
    })
}

#[cfg(test)]
mod tests;
