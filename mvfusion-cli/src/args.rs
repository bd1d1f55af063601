//! The command line.

mod compute;
mod config;
mod crop;
mod lpips;
mod manuals;
mod output;
mod page;
mod prepare;
mod suggested;
mod sweep;
#[cfg(feature = "viewer")]
mod viewer;

use std::num::NonZeroUsize;
use std::path::PathBuf;

use bytesize::ByteSize;
use clap::builder::{ArgPredicate, PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use mvfusion_data::Layout;
use mvfusion_model::config::FusionWeights;
use mvfusion_model::evaluation::{Protocol, Replacement};
use mvfusion_model::model::motion::MotionModule;
use mvfusion_model::train::IMAGE_CACHE;

use crate::export::moving::Precision;
use crate::help;
use crate::program;
use crate::progress::{Form, Verbosity};
use crate::render::{
    FileFormat, LayerChoice, Views, parse_fps, parse_frames, parse_layer, parse_size, parse_time, parse_weights,
};

pub use compute::ComputeArgs;
pub use config::{ConfigArgs, ConfigSourceArgs};
pub use crop::CropArgs;
pub use lpips::LpipsWeightsArgs;
pub use manuals::{CompletionsArgs, ManArgs};
pub use output::{ListArgs, ProgressForm};
pub use page::PageArgs;
pub use prepare::{GpuChoice, MatcherChoice, PrepareArgs, SyncChoice};
pub use sweep::{Launcher, RunCellArgs, SweepAction, SweepArgs, SweepFolderArgs, SweepRunArgs, SweepShowArgs};
#[cfg(feature = "viewer")]
pub use viewer::{TrainViewArgs, ViewArgs};

/// Gaussian splatting of dynamic scenes: a static and a dynamic branch, separated without supervision.
#[derive(Debug, Parser)]
#[command(name = "mvfusion", version, long_about = help::PROGRAM, arg_required_else_help = true)]
#[command(long_version = program::long_version())]
#[command(max_term_width = 100)]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
    /// The amount of output.
    #[command(flatten)]
    pub output: OutputArgs,
}

/// The amount of output on stderr.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct OutputArgs {
    /// Print only errors and the final table
    #[arg(short, long, global = true, conflicts_with = "verbose", display_order = 900)]
    pub quiet: bool,
    /// Log more, and show all metrics: -v for information, -vv for debugging (or set RUST_LOG)
    #[arg(short, long, global = true, action = clap::ArgAction::Count, display_order = 901)]
    pub verbose: u8,
    /// How notes and progress are shown on stderr
    #[arg(long, value_name = "FORM", value_enum, default_value_t, global = true, display_order = 902)]
    #[arg(conflicts_with = "quiet", hide_default_value = true)]
    pub progress: ProgressForm,
}

impl OutputArgs {
    /// Whether progress and notes are shown.
    pub fn verbosity(self) -> Verbosity {
        let form = match self.progress {
            _ if self.quiet => Form::Silent,
            ProgressForm::Auto => Form::Normal,
            ProgressForm::Plain => Form::Lines,
            ProgressForm::None => Form::Notes,
            ProgressForm::Json => Form::Json,
        };
        Verbosity { form, all_metrics: self.verbose > 0 }
    }
}

/// A command of the program.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Train on a scene, evaluate, and write a run folder
    #[command(long_about = help::TRAIN, after_long_help = help::TRAIN_MORE)]
    Train(TrainArgs),
    /// Evaluate a run again from its checkpoint
    #[command(long_about = help::EVAL)]
    Eval(EvalArgs),
    /// Render the layers of a run: its views, a path around the scene, or a camera path file
    #[command(long_about = help::RENDER, after_long_help = help::RENDER_MORE)]
    Render(RenderArgs),
    /// Look at a run in a browser: orbit, play, layers, comparison with its photos
    #[cfg(feature = "viewer")]
    #[command(long_about = help::VIEW, after_long_help = help::VIEW_MORE)]
    View(ViewArgs),
    /// Export a run's Gaussians and cameras for viewers and other programs
    #[command(long_about = help::EXPORT, after_long_help = help::EXPORT_MORE)]
    Export(ExportArgs),
    /// Rebuild a run's report.html from its files
    #[command(long_about = help::REPORT)]
    Report(ReportArgs),
    /// Bring back the run that an unfinished run was to replace
    #[command(long_about = help::RESTORE)]
    Restore(RestoreArgs),
    /// Inspect a scene before training: its contents, its problems and their remedies
    #[command(long_about = help::CHECK)]
    Check(CheckArgs),
    /// Make the LPIPS weights out of files of torchvision and of the package lpips
    #[command(long_about = help::LPIPS, after_long_help = help::LPIPS_MORE)]
    LpipsWeights(LpipsWeightsArgs),
    /// Make a scene from photos or videos without poses, by the program COLMAP
    #[command(long_about = help::PREPARE, after_long_help = help::PREPARE_MORE)]
    Prepare(PrepareArgs),
    /// Write a built-in scene to disk in a common dataset layout
    #[command(long_about = help::SYNTH)]
    Synth(SynthArgs),
    /// Print the configuration that `train` would use, as TOML
    #[command(long_about = help::CONFIG)]
    Config(ConfigArgs),
    /// Train and compare many runs: the cells of a grid file, or of a grid that ships with the program
    #[command(long_about = help::SWEEP, after_long_help = help::SWEEP_MORE)]
    Sweep(SweepArgs),
    /// List the presets
    Presets(ListArgs),
    /// List the devices that --device accepts in this build, with their limits
    Devices(ListArgs),
    /// Print the completions of a shell
    #[command(long_about = help::COMPLETIONS)]
    Completions(CompletionsArgs),
    /// Write a manual page for the program and for each command
    #[command(long_about = help::MAN)]
    Man(ManArgs),
}

impl Command {
    /// The requested number of threads.
    pub fn threads(&self) -> Option<NonZeroUsize> {
        match self {
            Self::Train(args) => args.compute.threads,
            Self::Eval(args) => args.compute.threads,
            Self::Export(args) => args.compute.threads,
            Self::Check(args) => args.compute.threads,
            Self::Prepare(args) => args.threads,
            Self::Render(args) => args.compute.threads,
            #[cfg(feature = "viewer")]
            Self::View(args) => args.compute.threads,
            Self::Sweep(args) => match &args.action {
                Some(SweepAction::RunCell(args)) => args.compute.threads,
                // The cells run in other processes.
                _ => Some(NonZeroUsize::MIN),
            },
            Self::LpipsWeights(_)
            | Self::Synth(_)
            | Self::Config(_)
            | Self::Presets(_)
            | Self::Devices(_)
            | Self::Report(_)
            | Self::Restore(_) => None,
            Self::Completions(_) | Self::Man(_) => Some(NonZeroUsize::MIN),
        }
    }
}

/// Parses the key of a layout.
fn layouts() -> impl TypedValueParser<Value = Layout> {
    // Proof: the preceding parser accepts nothing else.
    let layout = |key: String| Layout::of_key(&key).expect("one of the keys");
    PossibleValuesParser::new(Layout::ALL.map(Layout::key)).map(layout)
}

/// Parses the name of a protocol.
fn protocols() -> impl TypedValueParser<Value = Protocol> {
    // Proof: the preceding parser accepts nothing else.
    let protocol = |name: String| name.parse::<Protocol>().expect("one of the names");
    PossibleValuesParser::new(Protocol::ALL.map(Protocol::name)).map(protocol)
}

/// What `--replace` names: one output and what replaces it, or all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplacementChoice {
    /// Every module with every replacement.
    All,
    /// One of them.
    One(MotionModule, Replacement),
}

/// Parses a value of `--replace`.
fn parse_replacement(text: &str) -> Result<ReplacementChoice, String> {
    if text == "all" {
        return Ok(ReplacementChoice::All);
    }
    let (module, replacement) =
        text.split_once('=').ok_or("give a module and what replaces its output, such as mvg=constant, or all")?;
    let module = MotionModule::ALL.into_iter().find(|known| known.name() == module);
    let replacement = Replacement::ALL.into_iter().find(|known| known.name() == replacement);
    Ok(ReplacementChoice::One(
        module.ok_or("the modules are mvg and mfta")?,
        replacement.ok_or("the replacements are constant, mean and shuffled")?,
    ))
}

/// `mvfusion train`.
#[derive(Clone, Debug, Args)]
pub struct TrainArgs {
    /// Scene folder [default: the built-in scene]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Configuration.
    #[command(flatten)]
    pub sources: ConfigSourceArgs,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Memory for decoded images; images that do not fit are decoded again shortly before use
    #[arg(long, value_name = "SIZE", default_value_t = ByteSize(IMAGE_CACHE))]
    pub image_cache: ByteSize,
    /// Try even if the memory does not suffice by our estimate
    #[arg(long)]
    pub force_memory: bool,
    /// Folder with the LPIPS weights (docs/evaluation.md), or none; same as --set eval.lpips_weights=DIR
    #[arg(long, value_name = "DIR")]
    pub lpips_weights: Option<PathBuf>,
    /// Run folder [default: runs/NAME-SEED, where NAME is the preset or the scene]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace the run in the folder
    ///
    /// The old run is kept in the subfolder .replaced until the new one is complete; until then, `mvfusion restore`
    /// brings it back. If the new one fails before its first step, the old run is restored.
    #[arg(long)]
    pub force: bool,
    /// The page on which it can be watched.
    #[cfg(feature = "viewer")]
    #[command(flatten)]
    pub viewer: TrainViewArgs,
    /// Begin with the weights of the newest checkpoint of another run, at step 0
    ///
    /// Model and motion statistics are taken over; moments, schedules and random streams begin anew. The configuration
    /// must describe the same model: --config RUN/config.toml uses that of the other run.
    #[arg(long, value_name = "RUN", conflicts_with = "resume")]
    pub init_from: Option<PathBuf>,
    /// Continue the run in this folder from its newest checkpoint
    ///
    /// The result is that of an uninterrupted run. The configuration is that of the run; --set may change keys of
    /// `eval` and those of checkpoints and logs, and lengthen the last stage, also of a finished run. The device is that of
    /// the run too, unless --device names another one.
    #[arg(long, value_name = "RUN", conflicts_with_all = ["out", "force", "preset", "config", "format", "seed"])]
    pub resume: Option<PathBuf>,
}

impl Default for TrainArgs {
    /// `mvfusion train` without options.
    fn default() -> Self {
        #[derive(Parser)]
        struct Alone {
            #[command(flatten)]
            args: TrainArgs,
        }
        // Proof: no option of this command is required.
        Alone::try_parse_from(["train"]).expect("no option is required").args
    }
}

/// `mvfusion eval`.
#[derive(Clone, Debug, Args)]
pub struct EvalArgs {
    /// Run folder
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Scene folder, if it has moved since training
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Folder of masks (white = dynamic), if they have moved or were added later; see eval.dynamic_masks
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Folder with the LPIPS weights (docs/evaluation.md), if they have moved or training had none; or none
    #[arg(long, value_name = "DIR")]
    pub lpips_weights: Option<PathBuf>,
    /// Evaluation protocol: mvfusion (all metrics), or that of degauss, 3dgs or nerfbaselines
    #[arg(long, value_name = "NAME", default_value = Protocol::default().name(), value_parser = protocols())]
    pub protocol: Protocol,
    /// Frames for measuring the frame rate, with and without MFTA, after 20 warm-up frames; 0 skips the measurement,
    /// which can take minutes for large images on a CPU
    #[arg(long, value_name = "N", default_value_t = 300)]
    pub speed_frames: usize,
    /// Evaluate with a motion-aware module's output replaced, instead of the run as it is: MODULE=WHAT, or `all`
    ///
    /// MODULE is mvg or mfta. WHAT is constant (the mean over all Gaussians and times), mean (each Gaussian's mean over
    /// time), or shuffled (the output of another Gaussian at the same time). May be given more than once; each one is
    /// evaluated by itself. With --write, the metrics go to replacements.json and the report.
    #[arg(long, value_name = "MODULE=WHAT", value_parser = parse_replacement, conflicts_with = "protocol")]
    pub replace: Vec<ReplacementChoice>,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Write metrics, images and report to the run folder; by default, nothing is written
    #[arg(long)]
    pub write: bool,
    /// Print the metrics as JSON, with the keys of results.json, or with --replace of replacements.json
    #[arg(long)]
    pub json: bool,
}

/// `mvfusion export`.
#[derive(Clone, Debug, Args)]
pub struct ExportArgs {
    /// Run folder
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Output folder; --html needs none
    #[arg(long, value_name = "DIR", required_unless_present = "html")]
    #[arg(default_value_if("html", ArgPredicate::IsPresent, "."), hide_default_value = true)]
    pub out: PathBuf,
    /// The page that plays the scene.
    #[command(flatten)]
    pub page: PageArgs,
    /// What to write besides cameras.json, separated by commas
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "ply")]
    pub format: Vec<ExportFormat>,
    /// Time of the dynamic Gaussians, 0 to 1 [default: the canonical Gaussians for ply and npz, otherwise 0]
    #[arg(long, value_name = "T", value_parser = parse_time)]
    pub time: Option<f64>,
    /// Also write a sequence of N PLY files, from time 0 to the last training time; their size is printed first. With
    /// --format npz, the files are those of the dynamic branch as arrays
    #[arg(long, value_name = "N", value_parser = parse_frames)]
    pub frames: Option<NonZeroUsize>,
    /// Leave the static Gaussians out of the sequence; static.ply has them once, to be opened beside it
    #[arg(long, requires = "frames")]
    pub shared_static: bool,
    /// Number of times that scene.4dgs stores; between them, Gaussians move on straight lines [default: one for each
    /// training time, at most 60]
    #[arg(long, value_name = "N", value_parser = parse_frames)]
    pub samples: Option<NonZeroUsize>,
    /// How much the numbers in scene.4dgs may be off [default: fine]
    #[arg(long, value_name = "NAME", value_enum)]
    pub precision: Option<Precision>,
    /// Deform the dynamic Gaussians without temporal attention, as in the paper's cheaper inference
    #[arg(long)]
    pub no_mfta: bool,
    /// The part of the scene.
    #[command(flatten)]
    pub crop: CropArgs,
    /// Scene folder, if it has moved since training
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Replace the export in the folder, or the HTML file
    #[arg(long)]
    pub force: bool,
}

/// What `mvfusion export` writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// static.ply and dynamic.ply, each branch with all its parameters
    Ply,
    /// scene.splat, both branches as they look together
    Splat,
    /// The folder layout of 3DGS: point_cloud/iteration_N/point_cloud.ply, cfg_args, input.ply
    Inria,
    /// scene.glb, both branches at one time, as glTF with KHR_gaussian_splatting
    Glb,
    /// scene.4dgs, both branches in motion, in one file that players can seek in
    #[value(name = "4dgs")]
    Moving,
    /// static.npz and dynamic.npz, each branch as NumPy arrays, activated
    Npz,
}

/// `mvfusion check`.
#[derive(Clone, Debug, Args)]
pub struct CheckArgs {
    /// Scene folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// How the scene is read, and the configuration that would train on it.
    #[command(flatten)]
    pub sources: ConfigSourceArgs,
    /// Print the findings as JSON
    #[arg(long)]
    pub json: bool,
    /// Decode at most one image per camera
    ///
    /// Broken, empty and duplicate images may then go unnoticed.
    #[arg(long)]
    pub quick: bool,
    /// Output file for the points drawn over several photos [default: check-NAME.png]
    #[arg(long, value_name = "FILE")]
    pub picture: Option<PathBuf>,
    /// Do not draw the points over photos
    #[arg(long, conflicts_with = "picture")]
    pub no_picture: bool,
    /// Do not predict the time of a training
    ///
    /// The prediction trains for some seconds, at most about 20.
    #[arg(long)]
    pub no_time: bool,
    /// Device and threads for which the time is predicted.
    #[command(flatten)]
    pub compute: ComputeArgs,
}

/// `mvfusion synth`.
#[derive(Clone, Debug, Args)]
pub struct SynthArgs {
    /// Output folder
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// Dataset layout
    #[arg(long, value_name = "NAME", value_parser = layouts())]
    pub layout: Layout,
    /// Seed of the scene
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Image size
    #[arg(long, value_name = "WxH", default_value = "160x120", value_parser = parse_size)]
    pub size: (usize, usize),
    /// Frames per camera of a video [default: 24]
    #[arg(long, value_name = "N")]
    pub frames: Option<NonZeroUsize>,
    /// Training photos [default: 60]
    #[arg(long, value_name = "N")]
    pub photos: Option<NonZeroUsize>,
}

/// `mvfusion render`.
#[derive(Clone, Debug, Args)]
pub struct RenderArgs {
    /// Run folder
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Scene folder, if it has moved since training
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Views to render: train, test, spiral, orbit, still, or a camera path FILE.json
    #[arg(long, value_name = "VIEWS", default_value = "spiral")]
    pub views: Views,
    /// Layers, separated by commas, or all [default: composed, static, dynamic, mask, depth and motion, as far as the
    /// model has them]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', value_parser = parse_layer)]
    pub layers: Vec<LayerChoice>,
    /// File formats, separated by commas [default: png, gif, and mp4 if ffmpeg is installed; png for a single frame]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub format: Vec<FileFormat>,
    /// Number of frames [default: 120 on a path; otherwise all views, time steps or file entries]
    #[arg(long, value_name = "N", value_parser = parse_frames)]
    pub frames: Option<NonZeroUsize>,
    /// Render all frames at time T, 0 to 1 [default: time runs through once, or is that of the view; held-out photos
    /// have no time and show the static branch]
    #[arg(long, value_name = "T", value_parser = parse_time)]
    pub time: Option<f64>,
    /// Camera for --views still: a view (cam00/0003), a camera (cam00), or the index of a held-out view [default: 0]
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
    /// Image size; the vertical field of view does not change
    #[arg(long, value_name = "WxH", value_parser = parse_size, conflicts_with = "downscale")]
    pub size: Option<(usize, usize)>,
    /// Divide width and height by N
    #[arg(long, value_name = "N")]
    pub downscale: Option<NonZeroUsize>,
    /// Weights of position, scale and rotation in the motion intensity [default: motion.weights of the run]
    #[arg(long, value_name = "P,S,R", value_parser = parse_weights)]
    pub motion_weights: Option<FusionWeights>,
    /// Leave out temporal attention (base deformation and MVG only), as in the paper's cheaper inference
    #[arg(long)]
    pub no_mfta: bool,
    /// The part of the scene.
    #[command(flatten)]
    pub crop: CropArgs,
    /// Frame rate of animations [default: that of the camera path, or 30]
    #[arg(long, value_name = "N", value_parser = parse_fps)]
    pub fps: Option<f64>,
    /// Output folder [default: RUN/films/VIEWS]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace earlier renders in the folder
    #[arg(long)]
    pub force: bool,
    /// Try even if the memory does not suffice by our estimate
    #[arg(long)]
    pub force_memory: bool,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
}

/// `mvfusion report`.
#[derive(Clone, Debug, Args)]
pub struct ReportArgs {
    /// Run folder
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
}

/// `mvfusion restore`.
#[derive(Clone, Debug, Args)]
pub struct RestoreArgs {
    /// Run folder
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Remove the unfinished run, even if it could be continued
    #[arg(long)]
    pub force: bool,
}
