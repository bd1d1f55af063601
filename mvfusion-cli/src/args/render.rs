//! The arguments of `mvfusion render`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use mvfusion_model::config::FusionWeights;

use super::compute::ComputeArgs;
use super::crop::CropArgs;
use super::numbers::parse_count;
use crate::render::{
    FileFormat, LayerChoice, Views, parse_fps, parse_frames, parse_layer, parse_size, parse_time, parse_weights,
};

/// `mvfusion render`.
#[derive(Clone, Debug, Args)]
#[command(allow_negative_numbers = true)]
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
    #[arg(long, value_name = "N", value_parser = parse_count)]
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
