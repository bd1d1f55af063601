//! The options of `mvfusion prepare`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};
use mvfusion_data::prepare::{Gpu, Matcher, Sync, lens_models};

use super::numbers::parse_count;
use crate::render::parse_fps;

/// `mvfusion prepare`.
#[derive(Clone, Debug, Args)]
pub struct PrepareArgs {
    /// Folder of photos, video of one moving camera, or folder with a video for each still camera
    #[arg(value_name = "INPUT")]
    pub input: PathBuf,
    /// Scene folder to make
    #[arg(long, value_name = "SCENE")]
    pub out: PathBuf,
    /// Frames per second to take of videos [default: 2 of a moving camera, all of still cameras]
    #[arg(long, value_name = "N", value_parser = parse_fps)]
    pub fps: Option<f64>,
    /// Folder of masks, white = moving, which COLMAP ignores; named as the photos, frames or cameras
    ///
    /// For a photo a.jpg a.png, for a frame of a moving camera frame_000012.png, for a camera cam03.png or
    /// cam03/0000.png. Without this option, what moves in the first seconds of still cameras is ignored.
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Seconds by which the recording of a camera started later than time zero; may be repeated
    #[arg(long, value_name = "CAM=SECONDS", value_parser = parse_offset, allow_hyphen_values = true)]
    pub offset: Vec<(String, f64)>,
    /// How other offsets between cameras are found
    #[arg(long, value_name = "HOW", value_enum, default_value_t)]
    pub sync: SyncChoice,
    /// The program COLMAP [default: colmap, on the path]
    #[arg(long, value_name = "PROGRAM")]
    pub colmap: Option<PathBuf>,
    /// The model to use of several that COLMAP cannot join [default: the one with the most images]
    #[arg(long, value_name = "N")]
    pub model: Option<usize>,
    /// The pairs of images that COLMAP compares
    #[arg(long, value_name = "HOW", value_enum, default_value_t)]
    pub matcher: MatcherChoice,
    /// COLMAP's lens model [default: OPENCV for photos and a moving camera, SIMPLE_RADIAL for still cameras]
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(lens_models()), hide_possible_values = true)]
    pub camera_model: Option<String>,
    /// All still cameras have one lens, such as cameras of one make at one zoom; by default, each has its own
    #[arg(long)]
    pub one_lens: bool,
    /// Whether COLMAP computes on a GPU
    #[arg(long, value_name = "WHEN", value_enum, default_value_t)]
    pub gpu: GpuChoice,
    /// CPU threads; with one and without a GPU, COLMAP gives the same poses again [default: all cores]
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub threads: Option<NonZeroUsize>,
    /// Seed of COLMAP's random numbers
    // COLMAP reads an int.
    #[arg(long, value_name = "N", default_value_t = 0)]
    #[arg(value_parser = clap::value_parser!(u64).range(..=i32::MAX as u64))]
    pub seed: u64,
    /// Replace an earlier output of this command
    #[arg(long)]
    pub force: bool,
}

/// How offsets between cameras are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum SyncChoice {
    /// Not: the videos are taken as synchronous
    #[default]
    None,
    /// From their sound, by ffmpeg
    Sound,
}

impl From<SyncChoice> for Sync {
    fn from(choice: SyncChoice) -> Self {
        match choice {
            SyncChoice::None => Self::None,
            SyncChoice::Sound => Self::Sound,
        }
    }
}

/// The pairs of images that COLMAP compares.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum MatcherChoice {
    /// All, but neighbours of long videos
    #[default]
    Auto,
    /// All
    Exhaustive,
    /// Neighbours in the order of the names
    Sequential,
}

impl From<MatcherChoice> for Matcher {
    fn from(choice: MatcherChoice) -> Self {
        match choice {
            MatcherChoice::Auto => Self::Auto,
            MatcherChoice::Exhaustive => Self::Exhaustive,
            MatcherChoice::Sequential => Self::Sequential,
        }
    }
}

/// Whether COLMAP computes on a GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum GpuChoice {
    /// If it was built for CUDA and there is an NVIDIA GPU
    #[default]
    Auto,
    /// Always
    On,
    /// Never
    Off,
}

impl From<GpuChoice> for Gpu {
    fn from(choice: GpuChoice) -> Self {
        match choice {
            GpuChoice::Auto => Self::Auto,
            GpuChoice::On => Self::On,
            GpuChoice::Off => Self::Off,
        }
    }
}

/// Parses `cam03=-0.25`.
fn parse_offset(text: &str) -> Result<(String, f64), String> {
    let parsed = text.rsplit_once('=').and_then(|(name, seconds)| {
        let seconds = seconds.parse().ok().filter(|seconds: &f64| seconds.is_finite())?;
        (!name.is_empty()).then(|| (name.to_owned(), seconds))
    });
    parsed.ok_or_else(|| "expected a camera and seconds, such as cam03=-0.25".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_offset_is_a_camera_and_seconds() {
        assert_eq!(parse_offset("cam03=-0.25"), Ok(("cam03".into(), -0.25)));
        assert_eq!(parse_offset("a=b=2"), Ok(("a=b".into(), 2.0)));
        for bad in ["cam03", "cam03=", "=1", "cam03=nan", "cam03=1s"] {
            assert!(parse_offset(bad).is_err(), "{bad}");
        }
    }
}
