//! The command line: the program and its commands. The arguments of the commands are in `args/`.

mod check;
mod compute;
mod config;
mod crop;
mod eval;
mod export;
mod lpips;
mod manuals;
mod numbers;
mod output;
mod page;
mod prepare;
mod render;
mod report;
mod restore;
mod suggested;
mod sweep;
mod synth;
mod train;
#[cfg(feature = "viewer")]
mod viewer;

use std::num::NonZeroUsize;

use clap::{Args, Parser, Subcommand};

use crate::help;
use crate::program;
use crate::progress::{Form, Verbosity};

pub use check::CheckArgs;
pub use compute::ComputeArgs;
pub use config::{ConfigArgs, ConfigSourceArgs};
pub use crop::CropArgs;
pub use eval::{EvalArgs, ReplacementChoice};
pub use export::{ExportArgs, ExportFormat};
pub use lpips::LpipsWeightsArgs;
pub use manuals::{CompletionsArgs, ManArgs};
pub use output::{ListArgs, ProgressForm};
pub use page::PageArgs;
pub use prepare::{GpuChoice, MatcherChoice, PrepareArgs, SyncChoice};
pub use render::RenderArgs;
pub use report::ReportArgs;
pub use restore::RestoreArgs;
pub use sweep::{Launcher, RunCellArgs, SweepAction, SweepArgs, SweepFolderArgs, SweepRunArgs, SweepShowArgs};
pub use synth::SynthArgs;
pub use train::TrainArgs;
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
    /// Make a scene from photos or videos without poses, by the program COLMAP
    #[command(long_about = help::PREPARE, after_long_help = help::PREPARE_MORE)]
    Prepare(PrepareArgs),
    /// Write a built-in scene to disk in a common dataset layout
    #[command(long_about = help::SYNTH)]
    Synth(SynthArgs),
    /// Print the configuration that `train` would use, as TOML
    #[command(long_about = help::CONFIG)]
    Config(ConfigArgs),
    /// Make the LPIPS weights out of files of torchvision and of the package lpips
    #[command(long_about = help::LPIPS, after_long_help = help::LPIPS_MORE)]
    LpipsWeights(LpipsWeightsArgs),
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
            Self::Synth(_)
            | Self::Config(_)
            | Self::LpipsWeights(_)
            | Self::Presets(_)
            | Self::Devices(_)
            | Self::Report(_)
            | Self::Restore(_) => None,
            Self::Completions(_) | Self::Man(_) => Some(NonZeroUsize::MIN),
        }
    }
}
