//! The command line.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use bytesize::ByteSize;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand};
use mvfusion_data::{Format, Layout};
use mvfusion_model::train::IMAGE_CACHE;

use crate::command::parse_size;
use crate::help;
use crate::progress::Talk;

/// Gaussian splatting of dynamic scenes: a static and a dynamic branch, told apart without supervision.
#[derive(Debug, Parser)]
#[command(name = "mvfusion", version, long_about = help::PROGRAM, arg_required_else_help = true)]
#[command(max_term_width = 100)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// How much is said.
    #[command(flatten)]
    pub verbosity: Verbosity,
}

/// How much is said on stderr.
#[derive(Clone, Copy, Debug, Args)]
pub struct Verbosity {
    /// Say nothing but errors and the final table
    #[arg(short, long, global = true, conflicts_with = "verbose", display_order = 900)]
    pub quiet: bool,
    /// Log more: -v what you may act on, -vv everything (or set RUST_LOG)
    #[arg(short, long, global = true, action = clap::ArgAction::Count, display_order = 901)]
    pub verbose: u8,
}

impl Verbosity {
    /// Whether progress and notes are shown.
    pub fn talk(self) -> Talk {
        if self.quiet { Talk::Silent } else { Talk::Normal }
    }
}

/// A command of the program.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Train on a scene, evaluate, and write a run's folder
    #[command(long_about = help::TRAIN, after_long_help = help::TRAIN_MORE)]
    Train(TrainArgs),
    /// Evaluate a run again from its checkpoint
    #[command(long_about = help::EVAL)]
    Eval(EvalArgs),
    /// Look a scene over before training: what was found, what is wrong, what to do
    #[command(long_about = help::CHECK)]
    Check(CheckArgs),
    /// Write a built-in scene in a layout of the field
    #[command(long_about = help::SYNTH)]
    Synth(SynthArgs),
    /// Print the configuration that `train` would use, as TOML
    #[command(long_about = help::CONFIG)]
    Config(ConfigArgs),
    /// List the presets
    Presets,
    /// List the devices of this build that --device takes here, with their limits
    Devices,
}

impl Command {
    /// The number of threads asked for.
    pub fn threads(&self) -> Option<NonZeroUsize> {
        match self {
            Self::Train(args) => args.compute.threads,
            Self::Eval(args) => args.compute.threads,
            Self::Check(args) => args.threads,
            Self::Synth(_) | Self::Config(_) | Self::Presets | Self::Devices => None,
        }
    }
}

/// The layers of the configuration, but for the scene's folder.
#[derive(Clone, Debug, Default, Args)]
pub struct LayerArgs {
    /// Format of the scene's folder, if it is not to be recognised; the same as --set scene.format=NAME
    #[arg(long, value_name = "NAME", value_parser = formats())]
    pub format: Option<Format>,
    /// Where the configuration starts from (see `mvfusion presets`) [default: quickstart; with --data neu3d, or
    /// onthego-indoor for photos]
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

/// Takes a layout by its key.
fn layouts() -> impl TypedValueParser<Value = Layout> {
    // Proof: the parser before it lets nothing else through.
    let layout = |key: String| Layout::of_key(&key).expect("one of the keys");
    PossibleValuesParser::new(Layout::ALL.map(Layout::key)).map(layout)
}

/// What computes.
#[derive(Clone, Debug, Args)]
pub struct ComputeArgs {
    /// auto (a GPU if there is one), cpu, flex, ndarray, wgpu or cuda, with :N for the N-th (see `mvfusion devices`)
    #[arg(long, value_name = "D", default_value = "auto")]
    pub device: String,
    /// CPU threads; the result does not depend on it [default: all cores]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
}

/// `mvfusion train`.
#[derive(Clone, Debug, Args)]
pub struct TrainArgs {
    /// Folder of the scene; without it the built-in scene
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Configuration.
    #[command(flatten)]
    pub layers: LayerArgs,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Decoded pictures that are kept in memory; more are decoded again, ahead of their use
    #[arg(long, value_name = "SIZE", default_value_t = ByteSize(IMAGE_CACHE))]
    pub image_cache: ByteSize,
    /// Folder of the run [default: runs/NAME-SEED, NAME being the preset or the scene]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace the run that lies in the folder
    ///
    /// Until the first checkpoint the old run waits in the subfolder .replaced: a failure brings it back.
    #[arg(long)]
    pub force: bool,
}

/// `mvfusion config`.
#[derive(Clone, Debug, Args)]
pub struct ConfigArgs {
    /// Folder of the scene; without it the built-in scene
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// The rest of it.
    #[command(flatten)]
    pub layers: LayerArgs,
}

/// `mvfusion eval`.
#[derive(Clone, Debug, Args)]
pub struct EvalArgs {
    /// Folder of the run
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Folder of the scene, if it has moved since the training
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Folder of masks (white = dynamic), if they have moved or come later; see eval.dynamic_masks
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Write figures and pictures into the run's folder; without it nothing is written
    #[arg(long)]
    pub write: bool,
}

/// `mvfusion check`.
#[derive(Clone, Debug, Args)]
pub struct CheckArgs {
    /// Folder of the scene
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// How the scene is read and what would train on it.
    #[command(flatten)]
    pub layers: LayerArgs,
    /// Print what was found as JSON
    #[arg(long)]
    pub json: bool,
    /// Decode one picture of each camera at most, not all
    ///
    /// Broken, empty and repeated pictures are not found then.
    #[arg(long)]
    pub quick: bool,
    /// Where to draw the points over a few photos [default: check-NAME.png]
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Draw no picture
    #[arg(long, conflicts_with = "picture")]
    pub no_picture: bool,
    /// CPU threads [default: all cores]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
}

/// `mvfusion synth`.
#[derive(Clone, Debug, Args)]
pub struct SynthArgs {
    /// Folder to make
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// The layout
    #[arg(long, value_name = "NAME", value_parser = layouts())]
    pub layout: Layout,
    /// Seed of the scene
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Size of the pictures
    #[arg(long, value_name = "WxH", default_value = "160x120", value_parser = parse_size)]
    pub size: (usize, usize),
    /// Frames of each camera of a video [default: 24]
    #[arg(long, value_name = "N")]
    pub frames: Option<NonZeroUsize>,
    /// Photos to train on [default: 60]
    #[arg(long, value_name = "N")]
    pub photos: Option<NonZeroUsize>,
}
