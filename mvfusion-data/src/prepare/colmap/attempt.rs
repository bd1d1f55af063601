//! The steps of one attempt to place images, and their options.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::super::error::PrepareError;
use super::super::event::Listener;
use super::super::options::{ColmapOptions, Matcher};
use super::images::{Effort, Images, Kind};
use super::program::Program;
use super::step::{self, Log};

/// Up to this many frames of a video, every pair is compared: that closes loops, and takes minutes.
const FEW_FRAMES: usize = 150;

/// Names of an option in the versions of COLMAP, the newest first.
const EXTRACTION_GPU: [&str; 2] = ["FeatureExtraction.use_gpu", "SiftExtraction.use_gpu"];
const EXTRACTION_THREADS: [&str; 2] = ["FeatureExtraction.num_threads", "SiftExtraction.num_threads"];
const MATCHING_GPU: [&str; 2] = ["FeatureMatching.use_gpu", "SiftMatching.use_gpu"];
const MATCHING_THREADS: [&str; 2] = ["FeatureMatching.num_threads", "SiftMatching.num_threads"];
const GUIDED: [&str; 2] = ["FeatureMatching.guided_matching", "SiftMatching.guided_matching"];
const SEEDS: [&str; 2] = ["default_random_seed", "random_seed"];

/// One attempt to place images: three steps on one database.
pub(super) struct Attempt<'a, 'l> {
    pub(super) program: &'a Program,
    pub(super) options: &'a ColmapOptions,
    pub(super) images: Images<'a>,
    pub(super) effort: Effort,
    /// Whether features are found and compared on a GPU.
    pub(super) is_gpu: bool,
    pub(super) database: &'a Path,
    pub(super) log: &'a mut Log,
    pub(super) listen: &'a mut Listener<'l>,
}

impl Attempt<'_, '_> {
    /// Finds features in every image.
    ///
    /// # Errors
    /// [`PrepareError::Step`], as the other steps.
    pub(super) fn extract(&mut self) -> Result<(), PrepareError> {
        const STEP: &str = "feature_extractor";
        let (images, options) = (self.images, self.options);
        let mut step = self.step(STEP);
        let usual = if images.kind == Kind::Rig { "SIMPLE_RADIAL" } else { "OPENCV" };
        let is_one_camera = if images.kind == Kind::Rig && !options.one_lens { "0" } else { "1" };
        step.set(&["image_path"], images.folder);
        step.set(&["ImageReader.camera_model"], options.camera_model.as_deref().unwrap_or(usual));
        step.set(&["ImageReader.single_camera"], is_one_camera);
        if let Some(masks) = images.masks {
            step.set(&["ImageReader.mask_path"], masks);
        }
        step.set(&EXTRACTION_GPU, self.on_gpu());
        step.set(&EXTRACTION_THREADS, self.threads());
        if self.effort == Effort::Wide {
            step.set(&["SiftExtraction.estimate_affine_shape"], "1");
            step.set(&["SiftExtraction.domain_size_pooling"], "1");
            step.set(&["SiftExtraction.peak_threshold"], "0.002");
        }
        let counts = |line: &str| line.contains("Processed file [");
        self.run((STEP, step), ("features", images.count), counts)
    }

    /// Compares the features of pairs of images.
    pub(super) fn compare(&mut self) -> Result<(), PrepareError> {
        let images = self.images;
        let is_long_video = images.kind == Kind::Frames && images.count > FEW_FRAMES;
        let (name, total) = match self.options.matcher {
            Matcher::Sequential => ("sequential_matcher", images.count),
            Matcher::Auto if is_long_video => ("sequential_matcher", images.count),
            // COLMAP compares blocks of 50 images with each other.
            Matcher::Auto | Matcher::Exhaustive => ("exhaustive_matcher", images.count.div_ceil(50).pow(2)),
        };
        let mut step = self.step(name);
        step.set(&MATCHING_GPU, self.on_gpu());
        step.set(&MATCHING_THREADS, self.threads());
        if self.effort == Effort::Wide {
            step.set(&GUIDED, "1");
        }
        let counts = |line: &str| {
            ["Matching block [", "Matching image [", "Processing block [", "Processing image ["]
                .iter()
                .any(|start| line.contains(start))
        };
        self.run((name, step), ("matches", total), counts)
    }

    /// Places the images. The models lie in the folder `sparse` then.
    pub(super) fn map(&mut self, sparse: &Path) -> Result<(), PrepareError> {
        const STEP: &str = "mapper";
        let mut step = self.step(STEP);
        step.set(&["image_path"], self.images.folder);
        step.set(&["output_path"], sparse);
        step.set(&["Mapper.num_threads"], self.threads());
        step.set(&["Mapper.random_seed"], self.options.seed.to_string());
        let counts = |line: &str| line.contains("Registering image #");
        self.run((STEP, step), ("poses", self.images.count), counts)
    }

    fn on_gpu(&self) -> &'static str {
        if self.is_gpu { "1" } else { "0" }
    }

    fn threads(&self) -> String {
        self.options.threads.map_or("-1".into(), |threads| threads.to_string())
    }

    /// A step on the database, with the seed.
    fn step(&self, name: &str) -> Step {
        let mut step = Step { command: self.program.command(name), known: self.program.options_of(name) };
        step.set(&["database_path"], self.database);
        step.set(&SEEDS, self.options.seed.to_string());
        step
    }

    fn run(
        &mut self,
        (name, mut step): (&'static str, Step),
        progress: (&'static str, usize),
        counts: fn(&str) -> bool,
    ) -> Result<(), PrepareError> {
        step::run((name, &mut step.command), progress, counts, self.log, self.listen)
    }
}

/// A command with the options that it knows.
struct Step {
    command: Command,
    known: BTreeSet<String>,
}

impl Step {
    /// Sets the first of these options that the version knows. One that it does not know is left out.
    fn set(&mut self, names: &[&str], value: impl Into<PathBuf>) {
        if let Some(name) = names.iter().find(|name| self.known.contains(**name)) {
            self.command.arg(format!("--{name}")).arg(value.into());
        }
    }
}
