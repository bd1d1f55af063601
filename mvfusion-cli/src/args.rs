//! The command line.

mod compute;
mod config;
mod sweep;

use std::num::NonZeroUsize;
use std::path::PathBuf;

use bytesize::ByteSize;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use mvfusion_data::Layout;
use mvfusion_model::config::FusionWeights;
use mvfusion_model::evaluation::Protocol;
use mvfusion_model::train::IMAGE_CACHE;

use crate::help;
use crate::progress::Verbosity;
use crate::render::{
    FileFormat, LayerChoice, Views, parse_fps, parse_frames, parse_layer, parse_size, parse_time, parse_weights,
};

pub use compute::ComputeArgs;
pub use config::ConfigSourceArgs;
pub use sweep::{Launcher, RunCellArgs, SweepAction, SweepArgs, SweepFolderArgs, SweepRunArgs, SweepShowArgs};

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
    pub output: OutputArgs,
}

/// How much is said on stderr.
#[derive(Clone, Copy, Debug, Args)]
pub struct OutputArgs {
    /// Say nothing but errors and the final table
    #[arg(short, long, global = true, conflicts_with = "verbose", display_order = 900)]
    pub quiet: bool,
    /// Log more: -v what you may act on, -vv everything (or set RUST_LOG)
    #[arg(short, long, global = true, action = clap::ArgAction::Count, display_order = 901)]
    pub verbose: u8,
}

impl OutputArgs {
    /// Whether progress and notes are shown.
    pub fn verbosity(self) -> Verbosity {
        if self.quiet { Verbosity::Silent } else { Verbosity::Normal }
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
    /// Render a run in layers: its views, a path around the scene, or a path from a file
    #[command(long_about = help::RENDER, after_long_help = help::RENDER_MORE)]
    Render(RenderArgs),
    /// Write a run's Gaussians and cameras for viewers and other programs
    #[command(long_about = help::EXPORT, after_long_help = help::EXPORT_MORE)]
    Export(ExportArgs),
    /// Write a run's report.html again from its files
    #[command(long_about = help::REPORT)]
    Report(ReportArgs),
    /// Look a scene over before training: what was found, what is wrong, what to do
    #[command(long_about = help::CHECK)]
    Check(CheckArgs),
    /// Write a built-in scene in a layout of the field
    #[command(long_about = help::SYNTH)]
    Synth(SynthArgs),
    /// Print the configuration that `train` would use, as TOML
    #[command(long_about = help::CONFIG)]
    Config(ConfigArgs),
    /// Train and compare many runs: every combination of a grid file, or of one that ships with the program
    #[command(long_about = help::SWEEP, after_long_help = help::SWEEP_MORE)]
    Sweep(SweepArgs),
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
            Self::Export(args) => args.compute.threads,
            Self::Check(args) => args.threads,
            Self::Render(args) => args.compute.threads,
            Self::Sweep(args) => match &args.action {
                Some(SweepAction::RunCell(args)) => args.compute.threads,
                // The cells are other processes.
                _ => Some(NonZeroUsize::MIN),
            },
            Self::Synth(_) | Self::Config(_) | Self::Presets | Self::Devices | Self::Report(_) => None,
        }
    }
}

/// Takes a layout by its key.
fn layouts() -> impl TypedValueParser<Value = Layout> {
    // Proof: the parser before it lets nothing else through.
    let layout = |key: String| Layout::of_key(&key).expect("one of the keys");
    PossibleValuesParser::new(Layout::ALL.map(Layout::key)).map(layout)
}

/// Takes a protocol by its name.
fn protocols() -> impl TypedValueParser<Value = Protocol> {
    // Proof: the parser before it lets nothing else through.
    let protocol = |name: String| name.parse::<Protocol>().expect("one of the names");
    PossibleValuesParser::new(Protocol::ALL.map(Protocol::name)).map(protocol)
}

/// `mvfusion train`.
#[derive(Clone, Debug, Args)]
pub struct TrainArgs {
    /// Folder of the scene; without it the built-in scene
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Configuration.
    #[command(flatten)]
    pub sources: ConfigSourceArgs,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Decoded pictures that are kept in memory; more are decoded again, ahead of their use
    #[arg(long, value_name = "SIZE", default_value_t = ByteSize(IMAGE_CACHE))]
    pub image_cache: ByteSize,
    /// Folder with the weights of LPIPS (docs/evaluation.md); the same as --set eval.lpips_weights=DIR
    #[arg(long, value_name = "DIR")]
    pub lpips_weights: Option<PathBuf>,
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
    pub sources: ConfigSourceArgs,
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
    /// Folder with the weights of LPIPS (docs/evaluation.md), if the training had none or they have moved
    #[arg(long, value_name = "DIR")]
    pub lpips_weights: Option<PathBuf>,
    /// Whose metrics are computed: mvfusion (all of them), or those of degauss, 3dgs or nerfbaselines
    #[arg(long, value_name = "NAME", default_value = Protocol::default().name(), value_parser = protocols())]
    pub protocol: Protocol,
    /// Frames over which the speed of rendering is measured, after 20 that are not, with MFTA and without; 0 measures nothing,
    /// which saves minutes for large pictures on a CPU
    #[arg(long, value_name = "N", default_value_t = 300)]
    pub speed_frames: usize,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Write metrics, pictures and report into the run's folder; without it nothing is written
    #[arg(long)]
    pub write: bool,
}

/// `mvfusion export`.
#[derive(Clone, Debug, Args)]
pub struct ExportArgs {
    /// Folder of the run
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Folder to make
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// What to write beside cameras.json; several with commas between them
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "ply")]
    pub format: Vec<ExportFormat>,
    /// Time of the dynamic Gaussians, 0 to 1 [default: the canonical ones for ply, else 0]
    #[arg(long, value_name = "T", value_parser = parse_time)]
    pub time: Option<f64>,
    /// Write a sequence of so many files as well, from time 0 to the last one that was trained on
    #[arg(long, value_name = "N", value_parser = parse_frames)]
    pub frames: Option<NonZeroUsize>,
    /// Move the dynamic Gaussians without temporal attention, as the paper's cheaper inference does
    #[arg(long)]
    pub no_mfta: bool,
    /// Folder of the scene, if it has moved since the training
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Replace the export that lies in the folder
    #[arg(long)]
    pub force: bool,
}

/// What `mvfusion export` writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// static.ply and dynamic.ply, each branch with all its numbers
    Ply,
    /// scene.splat, both branches as they look together
    Splat,
    /// The folder of 3DGS: point_cloud/iteration_N/point_cloud.ply, cfg_args, input.ply
    Inria,
}

/// `mvfusion check`.
#[derive(Clone, Debug, Args)]
pub struct CheckArgs {
    /// Folder of the scene
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// How the scene is read and what would train on it.
    #[command(flatten)]
    pub sources: ConfigSourceArgs,
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

/// `mvfusion render`.
#[derive(Clone, Debug, Args)]
pub struct RenderArgs {
    /// Folder of the run
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Folder of the scene, if it has moved since the training
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// From where: train, test, spiral, orbit, still, or a camera path FILE.json
    #[arg(long, value_name = "VIEWS", default_value = "spiral")]
    pub views: Views,
    /// Layers, separated by commas, or all [default: composed, static, dynamic, mask, depth, motion, as far as the
    /// model has them]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = parse_layer)]
    pub layers: Vec<LayerChoice>,
    /// Kinds of files, separated by commas [default: png and gif, and mp4 if there is ffmpeg; png for a single frame]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub format: Vec<FileFormat>,
    /// Frames [default: 120 on a path; all views, moments, entries of a file]
    #[arg(long, value_name = "N", value_parser = parse_frames)]
    pub frames: Option<NonZeroUsize>,
    /// Stop the time at this moment, 0 to 1 [default: it runs through once, or is that of the view; held-out photos have
    /// none and show the static branch]
    #[arg(long, value_name = "T", value_parser = parse_time)]
    pub time: Option<f64>,
    /// For --views still: a view (cam00/0003), a camera (cam00), or the number of a held-out view [default: 0]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Size of the pictures, which see as much from top to bottom whatever their format
    #[arg(long, value_name = "WxH", value_parser = parse_size, conflicts_with = "downscale")]
    pub size: Option<(usize, usize)>,
    /// Render so many times smaller
    #[arg(long, value_name = "N")]
    pub downscale: Option<NonZeroUsize>,
    /// Weights of position, scale and rotation in the motion intensity [default: motion.weights of the run]
    #[arg(long, value_name = "P,S,R", value_parser = parse_weights)]
    pub motion_weights: Option<FusionWeights>,
    /// Leave the temporal attention out (base deformation and MVG alone), which is the paper's cheaper inference
    #[arg(long)]
    pub no_mfta: bool,
    /// Frames a second of animations [default: those of the camera path, or 30]
    #[arg(long, value_name = "N", value_parser = parse_fps)]
    pub fps: Option<f64>,
    /// Folder of the pictures [default: RUN/films/VIEWS]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace the pictures that lie in the folder
    #[arg(long)]
    pub force: bool,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
}

/// `mvfusion report`.
#[derive(Clone, Debug, Args)]
pub struct ReportArgs {
    /// Folder of the run
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
}
