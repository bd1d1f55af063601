//! The command line of `mvfusion sweep`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::compute::ComputeArgs;
use super::numbers::parse_count;

/// `mvfusion sweep`.
#[derive(Clone, Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct SweepArgs {
    /// An action other than training.
    #[command(subcommand)]
    pub action: Option<SweepAction>,
    /// The grid.
    #[command(flatten)]
    pub run: SweepRunArgs,
}

/// Actions on a sweep besides training its cells.
#[derive(Clone, Debug, Subcommand)]
pub enum SweepAction {
    /// Show the state of each cell of a sweep
    Status(SweepFolderArgs),
    /// Build the tables and plots from the finished cells, and print the table
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
    /// Sweep folder
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// A grid that ships with the program.
#[derive(Clone, Debug, Args)]
pub struct SweepShowArgs {
    /// Name of the grid
    #[arg(value_name = "NAME")]
    pub name: String,
}

/// One cell of a sweep.
#[derive(Clone, Debug, Args)]
pub struct RunCellArgs {
    /// Sweep folder
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Id of the cell
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
    /// Sweep folder [default: runs/sweeps/NAME]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Folder that contains the scene folders [default: the current folder]
    #[arg(long, value_name = "DIR")]
    pub data_root: Option<PathBuf>,
    /// Folder with the LPIPS weights (docs/evaluation.md), or none
    #[arg(long, value_name = "DIR")]
    pub lpips_weights: Option<PathBuf>,
    /// Set one key in every cell, such as train.scale=0.1; may be repeated
    #[arg(long, value_name = "KEY=VALUE", action = clap::ArgAction::Append)]
    pub set: Vec<String>,
    /// Train only the cells of these scenes
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Train only the cells of this variant; may be repeated
    #[arg(long = "variant", value_name = "NAME")]
    pub variants: Vec<String>,
    /// Train only the cells of these seeds
    #[arg(long, value_name = "N", value_delimiter = ',')]
    pub seeds: Vec<u64>,
    /// Number of cells to run at the same time; with slurm, an upper limit [default: on a CPU as many as threads, as far as
    /// the memory suffices; on a GPU, or if the grid measures frame rates, 1; with slurm, no limit]
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub jobs: Option<NonZeroUsize>,
    /// CPU threads, shared by the cells that run at the same time; with slurm, the threads of each cell [default: all
    /// cores; with slurm, 4]
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub threads: Option<NonZeroUsize>,
    /// Device of every cell (see `mvfusion train --help`)
    #[arg(long, value_name = "D", default_value = "auto")]
    pub device: String,
    /// Launcher of the cells
    #[arg(long, value_name = "NAME", default_value = "local")]
    pub launcher: Launcher,
    /// Option for sbatch, such as --sbatch=--partition=gpu; may be repeated
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true, action = clap::ArgAction::Append)]
    pub sbatch: Vec<String>,
    /// With slurm: wait until all cells have ended, including those of earlier arrays, then write the tables
    #[arg(long)]
    pub wait: bool,
    /// Show the cells and a time estimate, and train nothing
    #[arg(long)]
    pub dry_run: bool,
    /// With --dry-run: base the estimate on a few steps of one cell per scene and variant, run here and discarded
    #[arg(long, requires = "dry_run")]
    pub probe: bool,
}

/// The launcher of a sweep's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Launcher {
    /// Processes on this machine
    Local,
    /// A SLURM job array
    Slurm,
}
