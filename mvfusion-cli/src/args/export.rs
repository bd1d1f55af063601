//! The arguments of `mvfusion export`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::builder::ArgPredicate;
use clap::{Args, ValueEnum};

use super::compute::ComputeArgs;
use super::crop::CropArgs;
use super::page::PageArgs;
use crate::export::moving::Precision;
use crate::render::{parse_frames, parse_time};

/// `mvfusion export`.
#[derive(Clone, Debug, Args)]
#[command(allow_negative_numbers = true)]
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
