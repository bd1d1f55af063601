//! Poses by the program COLMAP, which must be installed.

mod models;
mod program;
mod step;

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::error::PrepareError;
use super::event::{Event, Listener};
use super::options::{ColmapOptions, Matcher};
pub(super) use models::{MadeModel, chosen};
use program::Program;
pub(super) use step::Log;

/// Up to this many frames of a video, every pair is compared: that closes loops, and takes minutes.
const FEW_FRAMES: usize = 150;

/// Names of an option in the versions of COLMAP, the newest first.
const EXTRACTION_GPU: [&str; 2] = ["FeatureExtraction.use_gpu", "SiftExtraction.use_gpu"];
const EXTRACTION_THREADS: [&str; 2] = ["FeatureExtraction.num_threads", "SiftExtraction.num_threads"];
const MATCHING_GPU: [&str; 2] = ["FeatureMatching.use_gpu", "SiftMatching.use_gpu"];
const MATCHING_THREADS: [&str; 2] = ["FeatureMatching.num_threads", "SiftMatching.num_threads"];
const GUIDED: [&str; 2] = ["FeatureMatching.guided_matching", "SiftMatching.guided_matching"];
const SEEDS: [&str; 2] = ["default_random_seed", "random_seed"];

/// The images that COLMAP places.
#[derive(Clone, Copy, Debug)]
pub(super) struct Images<'a> {
    /// Their folder.
    pub(super) folder: &'a Path,
    /// Their number.
    pub(super) count: usize,
    /// Folder of masks `NAME.png.png`, black = ignored.
    pub(super) masks: Option<&'a Path>,
    pub(super) kind: Kind,
}

/// Where the images come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// One camera, no order.
    Photos,
    /// One camera, in order.
    Frames,
    /// A camera each.
    Rig,
}

/// How much effort the search for common features takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Effort {
    /// COLMAP's defaults.
    Usual,
    /// Also weak and skewed features, for cameras that stand far apart. As many common ones are needed for a pose: with
    /// fewer, COLMAP places more cameras of a wide rig, and most of them in the wrong place.
    Wide,
}

/// Runs COLMAP.
#[derive(Clone, Debug)]
pub(super) struct Colmap<'a> {
    program: Program,
    options: &'a ColmapOptions,
}

impl<'a> Colmap<'a> {
    /// Finds the program.
    ///
    /// # Errors
    /// [`PrepareError::NoColmap`].
    pub(super) fn find(options: &'a ColmapOptions, listen: &mut Listener<'_>) -> Result<Self, PrepareError> {
        let program = Program::find(options.program.as_deref())?;
        if program.is_old() {
            let version = program.version();
            listen(Event::Note(format!("COLMAP {version} is older than 3.8, the oldest version that was tried")));
        }
        Ok(Self { program, options })
    }

    /// The program's version.
    pub(super) fn version(&self) -> &str {
        self.program.version()
    }

    /// The models of images, which are made in the folder `work`.
    ///
    /// # Errors
    /// [`PrepareError::Step`] if a step fails. That no model could be made is no error: there is none then.
    pub(super) fn models(
        &self,
        images: Images<'_>,
        effort: Effort,
        work: &Path,
        log: &mut Log,
        listen: &mut Listener<'_>,
    ) -> Result<Vec<MadeModel>, PrepareError> {
        let (database, sparse) = (work.join("database.db"), work.join("sparse"));
        // An earlier attempt lies there.
        let _ = fs::remove_file(&database);
        let _ = fs::remove_dir_all(&sparse);
        fs::create_dir_all(&sparse).map_err(|error| PrepareError::unwritable(&sparse, error))?;
        let is_gpu = effort == Effort::Usual && self.program.uses_gpu(self.options.gpu);
        self.extract(images, effort, is_gpu, &database, log, listen)?;
        self.compare(images, effort, is_gpu, &database, log, listen)?;
        let mapped = self.map(images, (&database, &sparse), log, listen);
        let models = MadeModel::all(&sparse)?;
        match mapped {
            // It also fails if it found no model, and says so.
            Err(PrepareError::Step { said, .. }) if models.is_empty() && is_no_model(&said) => Ok(models),
            Err(error) if models.is_empty() => Err(error),
            _ => Ok(models),
        }
    }

    fn extract(
        &self,
        images: Images<'_>,
        effort: Effort,
        is_gpu: bool,
        database: &Path,
        log: &mut Log,
        listen: &mut Listener<'_>,
    ) -> Result<(), PrepareError> {
        const STEP: &str = "feature_extractor";
        let mut step = self.step(STEP, database);
        let usual = if images.kind == Kind::Rig { "SIMPLE_RADIAL" } else { "OPENCV" };
        let is_one_camera = if images.kind == Kind::Rig && !self.options.one_lens { "0" } else { "1" };
        step.set(&["image_path"], images.folder);
        step.set(&["ImageReader.camera_model"], self.options.camera_model.as_deref().unwrap_or(usual));
        step.set(&["ImageReader.single_camera"], is_one_camera);
        if let Some(masks) = images.masks {
            step.set(&["ImageReader.mask_path"], masks);
        }
        step.set(&EXTRACTION_GPU, if is_gpu { "1" } else { "0" });
        step.set(&EXTRACTION_THREADS, self.threads());
        if effort == Effort::Wide {
            step.set(&["SiftExtraction.estimate_affine_shape"], "1");
            step.set(&["SiftExtraction.domain_size_pooling"], "1");
            step.set(&["SiftExtraction.peak_threshold"], "0.002");
        }
        let counts = |line: &str| line.contains("Processed file [");
        step::run((STEP, &mut step.command), ("features", images.count), counts, log, listen)
    }

    fn compare(
        &self,
        images: Images<'_>,
        effort: Effort,
        is_gpu: bool,
        database: &Path,
        log: &mut Log,
        listen: &mut Listener<'_>,
    ) -> Result<(), PrepareError> {
        let is_long_video = images.kind == Kind::Frames && images.count > FEW_FRAMES;
        let (name, total) = match self.options.matcher {
            Matcher::Sequential => ("sequential_matcher", images.count),
            Matcher::Auto if is_long_video => ("sequential_matcher", images.count),
            // COLMAP compares blocks of 50 images with each other.
            Matcher::Auto | Matcher::Exhaustive => ("exhaustive_matcher", images.count.div_ceil(50).pow(2)),
        };
        let mut step = self.step(name, database);
        step.set(&MATCHING_GPU, if is_gpu { "1" } else { "0" });
        step.set(&MATCHING_THREADS, self.threads());
        if effort == Effort::Wide {
            step.set(&GUIDED, "1");
        }
        let counts = |line: &str| {
            ["Matching block [", "Matching image [", "Processing block [", "Processing image ["]
                .iter()
                .any(|start| line.contains(start))
        };
        step::run((name, &mut step.command), ("matches", total), counts, log, listen)
    }

    fn map(
        &self,
        images: Images<'_>,
        (database, sparse): (&Path, &Path),
        log: &mut Log,
        listen: &mut Listener<'_>,
    ) -> Result<(), PrepareError> {
        const STEP: &str = "mapper";
        let mut step = self.step(STEP, database);
        step.set(&["image_path"], images.folder);
        step.set(&["output_path"], sparse);
        step.set(&["Mapper.num_threads"], self.threads());
        step.set(&["Mapper.random_seed"], self.options.seed.to_string());
        let counts = |line: &str| line.contains("Registering image #");
        step::run((STEP, &mut step.command), ("poses", images.count), counts, log, listen)
    }

    fn threads(&self) -> String {
        self.options.threads.map_or("-1".into(), |threads| threads.to_string())
    }

    /// A step on a database, with the seed.
    fn step(&self, name: &str, database: &Path) -> Step {
        let mut step = Step { command: self.program.command(name), known: self.program.options_of(name) };
        step.set(&["database_path"], database);
        step.set(&SEEDS, self.options.seed.to_string());
        step
    }
}

/// Whether the mapper's last words are that it made no model.
fn is_no_model(said: &str) -> bool {
    ["failed to create sparse model", "No good initial image pair", "no images with matches", "No images with matches"]
        .iter()
        .any(|words| said.contains(words))
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
