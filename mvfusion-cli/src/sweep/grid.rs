//! A grid file: what a sweep trains, and which table comes of it.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use mvfusion_data::files::read_text;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::shipped;
use crate::config::{Origin, PartialConfig, leaves, line_of};
use crate::failure::UsageError;
use crate::run;

/// The metrics of a column group that the grid does not name.
const METRICS: [&str; 3] = ["composed.psnr", "composed.ssim", "composed.lpips_alex"];

/// What stands in `not_comparable` of the paper's rows for all of their metrics.
pub(super) const ALL_METRICS: &str = "*";

/// A grid file. Cells are all scenes times all variants times all values of `[grid]` times all seeds.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Heading of the table.
    pub title: String,
    /// What it shows and where it comes from, for people.
    #[serde(default)]
    pub about: String,
    /// The preset that every cell starts from, unless its scene or variant names another.
    pub preset: String,
    /// Seeds; one run each.
    #[serde(default = "first_seed")]
    pub seeds: Vec<u64>,
    /// Frames over which the speed of rendering is measured after training; 0 measures none.
    #[serde(default)]
    pub speed_frames: usize,
    /// How long a cell takes, for the estimate before any has finished.
    pub expected: Option<Expected>,
    /// Keys of every cell.
    #[serde(default)]
    pub set: Table,
    /// The scenes.
    pub scenes: Vec<SceneEntry>,
    /// The variants; a grid without any has one that is nameless and changes nothing.
    #[serde(default)]
    pub variants: Vec<VariantEntry>,
    /// Lists of values, by key.
    #[serde(default)]
    pub grid: Table,
    /// Cells that are left out: those that agree with every key of an entry.
    #[serde(default)]
    pub exclude: Vec<Table>,
    /// Columns of the table; each scene one, with PSNR, SSIM and LPIPS of the composed picture, unless given.
    #[serde(default)]
    pub columns: Vec<ColumnGroup>,
    /// Pairs of variants whose differences the table shows too.
    #[serde(default)]
    pub differences: Vec<Difference>,
    /// How the differences are judged.
    pub rule: Option<Rule>,
    /// What the paper has.
    #[serde(default)]
    pub paper: Vec<PaperRow>,
}

/// A scene of a grid.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneEntry {
    /// Its name in the table.
    pub name: String,
    /// Its folder under `--data-root`; a built-in scene has none.
    pub data: Option<PathBuf>,
    /// Folder of its masks under `--data-root`, see `eval.dynamic_masks`.
    pub masks: Option<PathBuf>,
    /// The preset that its cells start from.
    pub preset: Option<String>,
    /// Keys of its cells.
    #[serde(default)]
    pub set: Table,
}

/// A variant of a grid.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VariantEntry {
    /// Its name in the table.
    pub name: String,
    /// The preset that its cells start from.
    pub preset: Option<String>,
    /// Keys of its cells.
    #[serde(default)]
    pub set: Table,
}

/// How long a cell takes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// Minutes of one cell.
    pub minutes: f64,
    /// On which machine.
    pub on: String,
}

/// Neighbouring columns of the table: some metrics of the mean over some scenes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColumnGroup {
    /// Heading.
    pub title: String,
    /// The scenes that are averaged; all of them if none is named.
    #[serde(default)]
    pub scenes: Vec<String>,
    /// Names of metrics, as in results.json: `composed.psnr`.
    pub metrics: Vec<String>,
}

/// Two variants that are compared seed by seed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Difference {
    /// The variant whose metrics come first.
    pub variant: String,
    /// The variant whose metrics are subtracted.
    pub minus: String,
}

/// How differences are judged. It stands in the grid, so that it is fixed before the first run.
///
/// A difference helps a scene if its confidence interval excludes 0 on the better side in every metric of the scene. It
/// harms the scene if the interval excludes 0 on the worse side in any of them. A variant is recommended if it helps
/// `least_helped` scenes and harms none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// Confidence of the two-sided t-interval of the mean of paired differences, between 0 and 1.
    #[serde(default = "usual_confidence")]
    pub confidence: f64,
    /// Number of scenes that a recommended variant helps at least.
    pub least_helped: usize,
    /// The scenes with their metrics.
    pub scenes: Vec<RuleScene>,
}

/// The metrics by which a difference is judged on a scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RuleScene {
    /// Name of the scene.
    pub scene: String,
    /// Names of metrics of a column that shows this scene alone.
    pub metrics: Vec<String>,
}

fn usual_confidence() -> f64 {
    0.95
}

/// What the paper has of one method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperRow {
    /// The variant whose row it belongs to.
    pub variant: Option<String>,
    /// A method that is not trained here, and has a row of its own.
    pub literature: Option<String>,
    /// The values of `[grid]` that the row belongs to, by key.
    #[serde(default)]
    pub at: Table,
    /// Heading of the column group.
    pub column: String,
    /// The numbers, by the metrics' names.
    pub values: BTreeMap<String, f64>,
    /// Why numbers say nothing about ours, by the metrics' names; `*` stands for all that have no reason of their own.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub not_comparable: BTreeMap<String, String>,
}

/// A key of `[grid]` with its values.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// The key, dotted.
    pub key: String,
    /// The values in the order of the file.
    pub values: Vec<Value>,
}

fn first_seed() -> Vec<u64> {
    vec![0]
}

impl PaperRow {
    /// Why its number of a metric says nothing about ours; absent where the row gives no reason.
    pub fn reason_against(&self, metric: &str) -> Option<&str> {
        let reason = self.not_comparable.get(metric).or_else(|| self.not_comparable.get(ALL_METRICS))?;
        // The table ends the sentence.
        Some(reason.trim().trim_end_matches('.'))
    }
}

impl Grid {
    /// Reads a grid: a file, or one that ships with the program, by its name.
    ///
    /// # Errors
    /// [`UsageError`] if there is no such file or grid, or it is none.
    pub fn read(name_or_path: &Path) -> Result<Source, UsageError> {
        if let Some(shipped) = name_or_path.to_str().and_then(shipped::find) {
            return Source::parse(shipped.name, shipped.text.to_owned(), format!("the grid `{}`", shipped.name));
        }
        let shown = name_or_path.display().to_string();
        let text = read_text(name_or_path, run::MOST_OF_SETTINGS).map_err(|error| {
            let hint = match error.kind() {
                ErrorKind::NotFound => {
                    let meant = shipped::suggestion(&shown);
                    format!("{meant} The grids that ship with the program are: {}.", shipped::names())
                }
                _ => String::new(),
            };
            UsageError::new(format!("cannot read the grid {shown}: {error}.{hint}"))
        })?;
        let name = name_or_path.file_stem().map_or("sweep".into(), |stem| stem.to_string_lossy());
        Source::parse(&name, text, shown)
    }

    /// The axes of `[grid]`; nested tables and dotted keys are the same.
    pub fn axes(&self) -> Result<Vec<Axis>, UsageError> {
        let axis = |(key, value): (String, &Value)| match value {
            Value::Array(values) => Ok(Axis { key, values: values.clone() }),
            _ => Err(UsageError::new(format!("`{key}` in [grid] must be a list of values, not {value}."))),
        };
        leaves(&self.grid).into_iter().map(axis).collect()
    }

    /// The columns of the table; those that average over all scenes name them.
    pub fn column_groups(&self) -> Vec<ColumnGroup> {
        let all = || self.scenes.iter().map(|scene| scene.name.clone()).collect::<Vec<_>>();
        if self.columns.is_empty() {
            let metrics = METRICS.map(str::to_owned).to_vec();
            let of_scene =
                |name: String| ColumnGroup { title: name.clone(), scenes: vec![name], metrics: metrics.clone() };
            return all().into_iter().map(of_scene).collect();
        }
        let named = |column: &ColumnGroup| {
            let scenes = if column.scenes.is_empty() { all() } else { column.scenes.clone() };
            ColumnGroup { scenes, ..column.clone() }
        };
        self.columns.iter().map(named).collect()
    }
}

/// A grid with its name and text.
#[derive(Clone, Debug)]
pub struct Source {
    /// Its name, from which that of its folder follows.
    pub name: String,
    /// The text.
    pub text: String,
    /// Where the text comes from, for messages.
    pub origin: String,
    /// The grid.
    pub grid: Grid,
}

impl Source {
    fn parse(name: &str, text: String, origin: String) -> Result<Self, UsageError> {
        // A text that is no TOML is told from one that is no grid.
        PartialConfig::parse(&text, Origin::Grid(origin.clone()))?;
        let grid = toml::from_str(&text).map_err(|error: toml::de::Error| {
            let line = error.span().map_or(String::new(), |span| format!(", line {}", line_of(&text, span.start)));
            UsageError::new(format!("{origin}{line} is no grid: {}.", error.message()))
        })?;
        Ok(Self { name: name.to_owned(), text, origin, grid })
    }
}

/// Equality of values that does not ask how a number was written: 1 is 1.0.
pub(super) fn is_same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_same(a, b)),
        _ => match (number(a), number(b)) {
            (Some(a), Some(b)) => a == b,
            _ => a == b,
        },
    }
}

/// A value as a number.
pub(super) fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(value) => Some(*value as f64),
        Value::Float(value) => Some(*value),
        _ => None,
    }
}
