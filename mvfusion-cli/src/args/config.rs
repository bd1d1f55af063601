//! The options from which a configuration is merged, and those that tell of its keys.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use mvfusion_data::Format;
use mvfusion_model::Config;
use toml::Table;

use crate::config::PRESETS;

use super::suggested::Suggested;

/// `mvfusion config`.
#[derive(Clone, Debug, Args)]
pub struct ConfigArgs {
    /// Scene folder [default: the built-in scene]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// The other sources.
    #[command(flatten)]
    pub sources: ConfigSourceArgs,
    /// Print a configuration file with all that is known of each key as comments
    #[arg(long)]
    pub template: bool,
    /// Print what a key or a table means, accepts and is by default, and what the presets make of it
    #[arg(long, value_name = "KEY", value_parser = keys(), hide_possible_values = true)]
    #[arg(conflicts_with_all = ALL_SOURCES)]
    pub explain: Option<String>,
    /// Print the JSON schema of configuration files, with which editors complete and check them
    #[arg(long, conflicts_with_all = ALL_SOURCES, conflicts_with = "explain")]
    pub schema: bool,
}

/// Options that have no effect on what is known of the keys.
const ALL_SOURCES: [&str; 7] = ["data", "format", "preset", "config", "set", "seed", "template"];

/// The sources of the configuration, except the folder of the scene.
#[derive(Clone, Debug, Default, Args)]
pub struct ConfigSourceArgs {
    /// Scene format, instead of detecting it; same as --set scene.format=NAME
    #[arg(long, value_name = "NAME", value_parser = formats())]
    pub format: Option<Format>,
    /// Preset to start from (see `mvfusion presets`) [default: quickstart; with --data neu3d, or hypernerf for layouts
    /// of one moving camera, dnerf for synthetic objects, onthego-indoor for photos]
    #[arg(long, value_name = "NAME", value_parser = presets(), hide_possible_values = true)]
    pub preset: Option<String>,
    /// TOML file that overrides the preset
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set one key, such as train.scale=0.1; may be repeated, and the last value wins
    #[arg(long, value_name = "KEY=VALUE", action = clap::ArgAction::Append)]
    pub set: Vec<String>,
    /// Keys from a program that embeds this one; they override the file
    #[arg(skip)]
    pub table: Option<Table>,
    /// Seed of all random numbers of the run; same as --set seed=N
    // TOML has no larger integers.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: Option<u64>,
}

/// Parses the key of a format.
fn formats() -> impl TypedValueParser<Value = Format> {
    // Proof: the preceding parser accepts nothing else.
    let format = |key: String| Format::of_key(&key).expect("one of the keys");
    PossibleValuesParser::new(Format::ALL.map(Format::key)).map(format)
}

/// Any text; completions offer the presets. Their own check has a better message than clap's.
fn presets() -> Suggested {
    Suggested(|| PRESETS.iter().map(|preset| PossibleValue::new(preset.name).help(preset.purpose)).collect())
}

/// Any text; completions offer the keys.
fn keys() -> Suggested {
    Suggested(|| {
        let keys = Config::key_notes().iter();
        keys.map(|notes| PossibleValue::new(notes.key.as_str()).help(notes.summary())).collect()
    })
}
