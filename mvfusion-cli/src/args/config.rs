//! The options that a configuration is merged from.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use mvfusion_data::Format;

/// The sources of the configuration, except the folder of the scene.
#[derive(Clone, Debug, Default, Args)]
pub struct ConfigSourceArgs {
    /// Format of the scene's folder, if it is not to be recognised; the same as --set scene.format=NAME
    #[arg(long, value_name = "NAME", value_parser = formats())]
    pub format: Option<Format>,
    /// Where the configuration starts from (see `mvfusion presets`) [default: quickstart; with --data neu3d, but
    /// hypernerf, dnerf or onthego-indoor for scenes of one moving camera, of synthetic objects, of photos]
    #[arg(long, value_name = "NAME")]
    pub preset: Option<String>,
    /// TOML file laid over the preset
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Set one key, such as train.scale=0.1; may be repeated, the last one wins
    #[arg(long, value_name = "KEY=VALUE", action = clap::ArgAction::Append)]
    pub set: Vec<String>,
    /// Seed of everything random in the run; the same as --set seed=N
    // TOML has no larger integers.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub seed: Option<u64>,
}

/// Takes a format by its key.
fn formats() -> impl TypedValueParser<Value = Format> {
    // Proof: the parser before it lets nothing else through.
    let format = |key: String| Format::of_key(&key).expect("one of the keys");
    PossibleValuesParser::new(Format::ALL.map(Format::key)).map(format)
}
