//! Options of preparing a scene.

use std::collections::BTreeMap;
use std::path::PathBuf;

/// Options of preparing a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PrepareOptions {
    /// Frames per second that are taken. By default, 2 of a hand-held video, and all frames of a rig's videos.
    pub fps: Option<f64>,
    /// Folder of masks, white = moving, which COLMAP ignores. Named as the photos, the chosen frames or the cameras.
    pub masks: Option<PathBuf>,
    /// By the name of a video without its extension: seconds by which its recording started later than time zero.
    pub offsets: BTreeMap<String, f64>,
    /// How offsets that are not given are found.
    pub sync: Sync,
    /// How COLMAP runs.
    pub colmap: ColmapOptions,
    /// Whether an earlier output of this program is replaced.
    pub replace: bool,
}

/// How the offsets between the videos of a rig are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sync {
    /// They are not: the videos are taken as synchronous. The default.
    #[default]
    None,
    /// From their sound.
    Sound,
}

/// How COLMAP runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColmapOptions {
    /// The program. By default, `colmap` on the path.
    pub program: Option<PathBuf>,
    /// Which pairs of images are compared.
    pub matcher: Matcher,
    /// COLMAP's name of the lens model. By default, OPENCV for one camera, SIMPLE_RADIAL for each camera of a rig.
    pub camera_model: Option<String>,
    /// Whether the cameras of a rig share one lens. By default, each has its own.
    pub one_lens: bool,
    /// Whether it computes on a GPU.
    pub gpu: Gpu,
    /// Number of threads. By default, all. With one thread and no GPU, two runs give the same poses.
    pub threads: Option<usize>,
    /// Seed of its random numbers.
    pub seed: u64,
    /// The model to keep of several that cannot be joined. By default, the one with the most images.
    pub model: Option<usize>,
}

/// Which pairs of images COLMAP compares.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Matcher {
    /// Every pair, except for long videos. The default.
    #[default]
    Auto,
    /// Every pair.
    Exhaustive,
    /// Each image and the next ones in the order of their names.
    Sequential,
}

/// Whether COLMAP computes on a GPU.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gpu {
    /// If it was built for CUDA and the program nvidia-smi finds a GPU. The default.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}
