//! The arguments of `mvfusion train`.

use std::path::PathBuf;

use bytesize::ByteSize;
use clap::{Args, Parser};
use mvfusion_model::train::IMAGE_CACHE;

use super::compute::ComputeArgs;
use super::config::ConfigSourceArgs;
use super::numbers::parse_bytes;
#[cfg(feature = "viewer")]
use super::viewer::TrainViewArgs;

/// `mvfusion train`.
#[derive(Clone, Debug, Args)]
#[command(allow_negative_numbers = true)]
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
    #[arg(long, value_name = "SIZE", default_value_t = ByteSize(IMAGE_CACHE), value_parser = parse_bytes)]
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
    /// The result is that of an uninterrupted run. --data names a scene that has moved; other images are refused. The
    /// configuration is that of the run; --set may change keys of `eval` and those of checkpoints and logs, and
    /// lengthen the last stage, also of a finished run. The device is that of the run too, unless --device names
    /// another one.
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
