//! The command line of `mvfusion sweep`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::compute::ComputeArgs;

/// `mvfusion sweep`.
#[derive(Clone, Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct SweepArgs {
    /// What to do instead of training.
    #[command(subcommand)]
    pub action: Option<SweepAction>,
    /// The grid.
    #[command(flatten)]
    pub run: SweepRunArgs,
}

/// What can be done with a sweep beside training its cells.
#[derive(Clone, Debug, Subcommand)]
pub enum SweepAction {
    /// Show how far each cell of a sweep is
    Status(SweepFolderArgs),
    /// Write the tables and plots of the cells that have finished, and print the table
    Table(SweepFolderArgs),
    /// List the grids that ship with the program
    List,
    /// Print a grid that ships with the program
    Show(SweepShowArgs),
    /// Train one cell
    #[command(hide = true)]
    RunCell(RunCellArgs),
}

/// A sweep that has been started.
#[derive(Clone, Debug, Args)]
pub struct SweepFolderArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}

/// A grid that ships with the program.
#[derive(Clone, Debug, Args)]
pub struct SweepShowArgs {
    /// Its name
    #[arg(value_name = "NAME")]
    pub name: String,
}

/// One cell of a sweep.
#[derive(Clone, Debug, Args)]
pub struct RunCellArgs {
    /// Folder of the sweep
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Its id
    #[arg(long, value_name = "ID")]
    pub cell: String,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
}

/// A grid and how it is run.
#[derive(Clone, Debug, Args)]
pub struct SweepRunArgs {
    /// A grid file, or the name of a grid that ships with the program (see `mvfusion sweep list`)
    #[arg(value_name = "GRID", required = true)]
    pub grid: Option<PathBuf>,
    /// Folder of the sweep [default: runs/sweeps/NAME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Folder under which the scenes' folders lie [default: the current folder]
    #[arg(long, value_name = "DIR")]
    pub data_root: Option<PathBuf>,
    /// Folder with the weights of LPIPS (docs/evaluation.md)
    #[arg(long, value_name = "DIR")]
    pub lpips_weights: Option<PathBuf>,
    /// Set one key of every cell, such as train.scale=0.1; may be repeated
    #[arg(long, value_name = "KEY=VALUE", action = clap::ArgAction::Append)]
    pub set: Vec<String>,
    /// Train the cells of these scenes alone
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Train the cells of these seeds alone
    #[arg(long, value_name = "N", value_delimiter = ',')]
    pub seeds: Vec<u64>,
    /// Cells at the same time; with slurm the most of them [default: 1; with slurm as many as it likes]
    #[arg(long, value_name = "N")]
    pub jobs: Option<NonZeroUsize>,
    /// CPU threads, shared out among the cells that run at the same time; with slurm of each cell [default: all cores;
    /// with slurm 4]
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Device of every cell, see `mvfusion train --help`
    #[arg(long, value_name = "D", default_value = "auto")]
    pub device: String,
    /// What runs the cells
    #[arg(long, value_name = "NAME", default_value = "local")]
    pub launcher: Launcher,
    /// An option of sbatch, such as --sbatch=--partition=gpu; may be repeated
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true, action = clap::ArgAction::Append)]
    pub sbatch: Vec<String>,
    /// With slurm: wait until all cells have ended, those at work from an earlier array too, then write the tables
    #[arg(long)]
    pub wait: bool,
    /// Show the cells and how long they will take, and train nothing
    #[arg(long)]
    pub dry_run: bool,
    /// With --dry-run: go by a few steps of a cell of each scene and variant, trained here and thrown away
    #[arg(long, requires = "dry_run")]
    pub probe: bool,
}

/// What runs the cells of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Launcher {
    /// Processes on this machine
    Local,
    /// A job array of SLURM
    Slurm,
}
