//! The options from which a configuration is merged.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use mvfusion_data::Format;
use toml::Table;

/// The sources of the configuration, except the folder of the scene.
#[derive(Clone, Debug, Default, Args)]
pub struct ConfigSourceArgs {
    /// Scene format, instead of detecting it; same as --set scene.format=NAME
    #[arg(long, value_name = "NAME", value_parser = formats())]
    pub format: Option<Format>,
    /// Preset to start from (see `mvfusion presets`) [default: quickstart; with --data neu3d, or hypernerf for one
    /// moving camera, dnerf for synthetic objects, onthego-indoor for photos]
    #[arg(long, value_name = "NAME")]
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
