//! The configuration of a run, merged from partial ones: preset, `--config`, `--set`, `--seed` and `--data`.

mod explain;
mod keys;
mod partial;
mod preset;
mod preset_values;
mod template;

use std::path::{Path, PathBuf};

use anyhow::Context;
use mvfusion_data::files::read_text;
use mvfusion_data::readers::nerfstudio;
use mvfusion_data::{Capture, Format};
use mvfusion_model::{Config, ModelError};
use toml::{Table, Value};

use crate::args::ConfigSourceArgs;
use crate::failure::UsageError;
use crate::{lpips, run};
pub use explain::explain;
use keys::KnownKeys;
pub(crate) use keys::nearest;
pub(crate) use partial::{Origin, PartialConfig, leaves, line_of};
pub use preset::{PRESETS, Preset};
pub use template::template;

/// The preset for the built-in scene.
const FOR_BUILTIN: &str = "quickstart";

/// The preset for a folder with a video.
const FOR_VIDEO: &str = "neu3d";

/// The preset for a video of one or two moving cameras.
const FOR_ONE_CAMERA: &str = "hypernerf";

/// The preset for a synthetic object that moves.
const FOR_OBJECTS: &str = "dnerf";

/// The preset for a folder of photos.
const FOR_PHOTOS: &str = "onthego-indoor";

/// Keys, or beginnings of keys, that a resumed run may change: they have no effect on what it learns from finite numbers.
const RESUMABLE: [&str; 9] = [
    "eval.",
    "scene.data",
    "scene.frame_store",
    "train.log_interval",
    "train.tensorboard",
    "train.checkpoint_interval",
    "train.checkpoint_minutes",
    "train.keep_checkpoints",
    "train.on_bad_step",
];

/// A configuration and where it started from.
#[derive(Clone, Debug)]
pub struct Resolved {
    /// The configuration, as given: `train.scale` is not applied yet.
    pub config: Config,
    /// The preset it started from.
    pub preset: &'static Preset,
    /// A note for the user on how the preset was chosen, in one line.
    pub note: Option<String>,
}

/// Merges the command line with the preset. The scene folder overrides every other source.
///
/// # Errors
/// [`UsageError`] for an unknown preset or key, a value of the wrong type, a file that cannot be read or is not TOML,
/// and for values that training does not accept.
pub fn resolve(args: &ConfigSourceArgs, data: Option<&Path>) -> anyhow::Result<Resolved> {
    let partials = given_partials(args, data)?;
    let given = |key: &str| partials.iter().rev().find_map(|partial| partial.table.get("scene")?.get(key)?.as_str());
    let format = given("format").and_then(Format::of_key);
    let capture = given("capture").and_then(|word| Value::from(word).try_into().ok());
    let chosen = given("data").map(|folder| match (preset_for(Path::new(folder), format, capture), capture) {
        (Some(preset), None) => (preset, "chosen by the scene format".to_owned()),
        (Some(preset), Some(_)) => (preset, "chosen by the scene format and capture".to_owned()),
        // Training refuses the folder; a configuration may be for another machine.
        (None, _) => (FOR_VIDEO, format!("no known format was found in {folder}")),
    });
    let default = chosen.as_ref().map_or(FOR_BUILTIN, |&(preset, _)| preset);
    let preset = Preset::find(args.preset.as_deref().unwrap_or(default))?;
    let note = chosen.filter(|_| args.preset.is_none());
    let note = note.map(|(preset, reason)| format!("preset: {preset} ({reason}; --preset overrides it)"));

    let mut config = resolve_over(preset, partials)?;
    make_absolute(&mut config)?;
    Ok(Resolved { config, preset, note })
}

/// Merges partial configurations over a preset. Later ones override earlier ones. Paths are not changed.
///
/// # Errors
/// As [`resolve`].
pub(crate) fn resolve_over(preset: &'static Preset, partials: Vec<PartialConfig>) -> anyhow::Result<Config> {
    let config = merge(&[preset_chain(preset)?, partials.clone()].concat())?;
    config.check().map_err(|error| placed(error, &partials))?;
    Ok(config)
}

/// The error for a value that training does not accept, with the place where it was written. Later partials override
/// earlier ones.
fn placed(error: ModelError, partials: &[PartialConfig]) -> anyhow::Error {
    let ModelError::Config { key, .. } = &error else { return error.into() };
    match partials.iter().rev().find(|partial| partial.has(key)) {
        Some(partial) => UsageError::new(format!("{}: {error}", partial.place(key))).into(),
        // A value of the preset, which contradicts another one.
        None => error.into(),
    }
}

/// Reads the configuration file of a run.
///
/// # Errors
/// [`UsageError`] if the file cannot be read or is not a configuration of this version. A value that no version trained
/// with is refused as well.
pub fn read(path: &Path) -> anyhow::Result<Config> {
    let config = merge(&[read_partial(path)?])?;
    config.check_of_run().with_context(|| format!("cannot use the configuration {}", path.display()))?;
    Ok(config)
}

/// The configuration of a run that is resumed, with the changes of the command line. The last stage may grow.
///
/// # Errors
/// [`UsageError`] for a change that would make it another run, with both values.
pub(crate) fn resume(path: &Path, args: &ConfigSourceArgs, data: Option<&Path>) -> anyhow::Result<Config> {
    let stored = read_partial(path)?;
    let before = merge(std::slice::from_ref(&stored))?;
    let partials = [vec![stored], given_partials(args, data)?].concat();
    let mut config = merge(&partials)?;
    config.check_of_run().map_err(|error| placed(error, &partials))?;
    make_absolute(&mut config)?;
    let (last_stage, length) = last_stage(&before);
    let longer = |new: &str| new.parse().is_ok_and(|new: usize| new > length);
    let table = |config: &Config| -> anyhow::Result<Table> { Ok(to_toml(config)?.parse()?) };
    let (before, after) = (table(&before)?, table(&config)?);
    let (before, after) = (leaves(&before), leaves(&after));
    let shown = |values: &[(String, &Value)], key: &str| {
        values.iter().find(|(own, _)| own == key).map_or("nothing".to_owned(), |(_, value)| value.to_string())
    };
    let is_free = |key: &str| RESUMABLE.iter().any(|free| key.starts_with(free));
    for (key, _) in before.iter().chain(&after).filter(|(key, _)| !is_free(key)) {
        let (old, new) = (shown(&before, key), shown(&after, key));
        if old == new || (key == last_stage && longer(&new)) {
            continue;
        }
        let remedy = match key == last_stage {
            true => "A run can be trained longer, not shorter.",
            false => "Start a new run for another value.",
        };
        return Err(UsageError::new(format!("cannot resume with `{key}` = {new}: the run has {old}. {remedy}")).into());
    }
    Ok(config)
}

/// What a resumed run may change of a key, in words.
fn on_resume(key: &str) -> &'static str {
    match key {
        _ if RESUMABLE.iter().any(|free| key.starts_with(free)) => "a resumed run may change it",
        "train.stages.geometry" | "train.stages.deformation" | "train.stages.refinement" => {
            "a resumed run may raise it, if it is that of the last stage with steps"
        }
        _ => "a resumed run keeps it",
    }
}

/// The key and the length of the last stage that has steps.
pub(crate) fn last_stage(config: &Config) -> (&'static str, usize) {
    let stages = &config.train.stages;
    match (stages.refinement.0, stages.deformation.0) {
        (0, 0) => ("train.stages.geometry", stages.geometry.0),
        (0, deformation) => ("train.stages.deformation", deformation),
        (refinement, _) => ("train.stages.refinement", refinement),
    }
}

/// A configuration as TOML: every key with its value.
///
/// # Errors
/// If a path in it is not valid UTF-8.
pub fn to_toml(config: &Config) -> anyhow::Result<String> {
    toml::to_string(config).context("the configuration cannot be written as TOML")
}

/// The preset for the scene in a folder, chosen by its format and its capture, if that is given; `None` if no format is
/// recognised.
fn preset_for(folder: &Path, format: Option<Format>, capture: Option<Capture>) -> Option<&'static str> {
    let format = mvfusion_data::recognise(folder, format).ok()?;
    let capture = capture.unwrap_or_else(|| match format {
        Format::COLMAP | Format::ONTHEGO => Capture::Photos,
        Format::NERFSTUDIO => nerfstudio::capture(folder),
        _ => Capture::Video,
    });
    Some(match (format, capture) {
        (_, Capture::Photos) => FOR_PHOTOS,
        (Format::DNERF, Capture::Video) => FOR_OBJECTS,
        (Format::COLMAP | Format::ONTHEGO | Format::HYPERNERF, Capture::Video) => FOR_ONE_CAMERA,
        _ => FOR_VIDEO,
    })
}

/// A preset and the presets that it builds on, the most basic first.
fn preset_chain(preset: &'static Preset) -> Result<Vec<PartialConfig>, UsageError> {
    preset.lineage().into_iter().map(|preset| PartialConfig::parse(preset.text, Origin::Preset(preset.name))).collect()
}

/// The layers above the preset. Later items override earlier ones.
fn given_partials(args: &ConfigSourceArgs, data: Option<&Path>) -> anyhow::Result<Vec<PartialConfig>> {
    let mut partials = Vec::new();
    if let Some(path) = &args.config {
        partials.push(read_partial(path)?);
    }
    if let Some(table) = &args.table {
        partials.push(PartialConfig::of_table(table.clone(), Origin::Program));
    }
    for setting in &args.set {
        partials.push(PartialConfig::from_setting(setting)?);
    }
    if let Some(seed) = args.seed {
        let seed = i64::try_from(seed).map_err(|_| UsageError::new("--seed is too large for TOML."))?;
        partials.push(PartialConfig::of_one("seed", Value::Integer(seed), Origin::Flag("--seed")));
    }
    if let Some(format) = args.format {
        partials.push(PartialConfig::of_one(
            "scene.format",
            Value::String(format.key().to_owned()),
            Origin::Flag("--format"),
        ));
    }
    if let Some(data) = data {
        let data = data.to_str().ok_or_else(|| UsageError::new("--data is not valid UTF-8; rename the folder."))?;
        partials.push(PartialConfig::of_one("scene.data", Value::String(data.to_owned()), Origin::Flag("--data")));
    }
    Ok(partials)
}

fn read_partial(path: &Path) -> Result<PartialConfig, UsageError> {
    let text = read_text(path, run::MOST_OF_SETTINGS)
        .map_err(|error| UsageError::new(format!("cannot read the configuration {}: {error}.", path.display())))?;
    PartialConfig::parse(&text, Origin::File(path.to_owned()))
}

/// Merges partial configurations over the defaults. Every key is checked first. Later ones override earlier ones.
fn merge(partials: &[PartialConfig]) -> anyhow::Result<Config> {
    let known = KnownKeys::new()?;
    let mut merged = known.defaults().clone();
    for partial in partials {
        known.check(partial)?;
        overlay(&mut merged, &partial.table);
    }
    Value::Table(merged).try_into().map_err(|error| UsageError::new(format!("invalid configuration: {error}")).into())
}

fn overlay(below: &mut Table, above: &Table) {
    for (key, value) in above {
        match (below.get_mut(key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => overlay(below, above),
            _ => {
                below.insert(key.clone(), value.clone());
            }
        }
    }
}

/// Makes all paths absolute, so that a run finds its data from any current folder.
///
/// # Errors
/// [`UsageError`] for an empty path. If there is no current folder.
pub(crate) fn make_absolute(config: &mut Config) -> anyhow::Result<()> {
    let Config { scene, init, eval, .. } = config;
    let paths: [(&str, &mut Option<PathBuf>); 6] = [
        ("scene.data", &mut scene.data),
        ("scene.frame_store", &mut scene.frame_store),
        ("init.static_ply", &mut init.static_ply),
        ("init.dynamic_ply", &mut init.dynamic_ply),
        ("eval.dynamic_masks", &mut eval.dynamic_masks),
        ("eval.lpips_weights", &mut eval.lpips_weights),
    ];
    for (key, path) in paths {
        let is_none = |path: &&mut PathBuf| key == "eval.lpips_weights" && lpips::is_none(path);
        let Some(path) = path.as_mut().filter(|path| !is_none(path)) else { continue };
        if path.as_os_str().is_empty() {
            return Err(UsageError::new(format!("`{key}` is an empty path. Give a path, or leave it out.")).into());
        }
        *path = std::path::absolute(&*path).with_context(|| format!("cannot use the path {}", path.display()))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
