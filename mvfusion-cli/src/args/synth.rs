//! The arguments of `mvfusion synth`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use mvfusion_data::{BuiltinKind, Layout};

use crate::render::{parse_frames, parse_size};

/// `mvfusion synth`.
#[derive(Clone, Debug, Args)]
pub struct SynthArgs {
    /// Output folder
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// Dataset layout
    #[arg(long, value_name = "NAME", value_parser = layouts())]
    pub layout: Layout,
    /// Built-in scene [default: video, or casual in a layout for photos]
    #[arg(long, value_name = "NAME", value_parser = kinds())]
    pub scene: Option<BuiltinKind>,
    /// Seed of the scene
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Image size
    #[arg(long, value_name = "WxH", default_value = "160x120", value_parser = parse_size)]
    pub size: (usize, usize),
    /// Frames per camera of a video [default: 24]
    #[arg(long, value_name = "N", value_parser = parse_frames)]
    pub frames: Option<NonZeroUsize>,
    /// Training photos [default: 60]
    #[arg(long, value_name = "N", value_parser = parse_frames)]
    pub photos: Option<NonZeroUsize>,
}

/// Parses the key of a built-in scene.
fn kinds() -> impl TypedValueParser<Value = BuiltinKind> {
    // Proof: the preceding parser accepts nothing else.
    let kind = |key: String| BuiltinKind::of_key(&key).expect("one of the keys");
    PossibleValuesParser::new(BuiltinKind::ALL.map(BuiltinKind::key)).map(kind)
}

/// Parses the key of a layout.
fn layouts() -> impl TypedValueParser<Value = Layout> {
    // Proof: the preceding parser accepts nothing else.
    let layout = |key: String| Layout::of_key(&key).expect("one of the keys");
    PossibleValuesParser::new(Layout::ALL.map(Layout::key)).map(layout)
}
