//! The memory that a training run, or a rendering, will need, predicted before it starts.
//!
//! The prediction is a sum of terms that grow with the scene and the configuration: Gaussians, planes, pixels, decoded
//! images. The coefficients are from measured runs on the CPU (docs/performance.md, "Memory"), rounded up. A GPU needs
//! the same tensors and, which is not counted, up to 512 MiB of hidden rows for each group of heads (`mvfusion_render::mlp`).

use mvfusion_data::motion::{MotionFilm, MovingPixelsOptions};
use mvfusion_data::{Picture, Scene, rest_width};
use mvfusion_render::grid::GridLayout;
use mvfusion_render::objective::SLOPE_BYTES;
use serde::Serialize;

use crate::ModelError;
use crate::config::{Branches, Config, ModelConfig, MotionConfig, Temporal};
use crate::initial::{SceneMotion, initial_counts};
use crate::model::gaussians::Gaussians;
use crate::model::motion::{RefinementRules, token_width};
use crate::model::{Model, moments_together};

/// Bytes of the program itself, with its libraries and threads.
const PROGRAM: f64 = 80e6;

/// Bytes per static Gaussian: parameters, gradients, the optimiser's moments, projections and their adjoint.
const STILL_GAUSSIAN: f64 = 2.5e3;

/// Additional bytes per dynamic Gaussian and unit of the network's width.
const MOVING_GAUSSIAN: f64 = 94.0;

/// Bytes per value of the planes: value, gradient, the optimiser's moments and the penalties.
const GRID_NUMBER: f64 = 26.0;

/// Layers of the heads and of the motion modules, of which each has a square of the width as weights.
const LAYERS: usize = 12;

/// Width of the networks in the measured runs; [`PROGRAM`] includes their weights.
const PAPER_WIDTH: f64 = 128.0;

/// Bytes per Gaussian of a chunk and sample of a measurement of motion (docs/performance.md: 99 MB).
const MEASUREMENT: f64 = 100.0;

/// Bytes per pixel of a step's views, which all keep their layers for the backward pass.
const PIXEL: f64 = 900.0;

/// Bytes of a search for points on moving objects, per ray.
const SEED: f64 = 2e3;

/// The memory of a training run, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MemoryNeed {
    /// The program itself; in CPU memory on every device.
    pub program: f64,
    /// Decoded images; in CPU memory on every device.
    pub pictures: f64,
    /// The reduced images in which motion is detected, and the search for points in them; in CPU memory on every
    /// device.
    pub film: f64,
    /// Parameters and the data of a step, with the initial number of Gaussians.
    pub start: f64,
    /// The same with the largest number of Gaussians that the configuration allows.
    pub most: f64,
    /// The parts of `most`.
    #[serde(skip)]
    pub parts: MemoryParts,
}

/// The parts of a training run's largest need, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MemoryParts {
    /// Static Gaussians.
    pub static_: f64,
    /// Dynamic Gaussians.
    pub dynamic: f64,
    /// The planes of the HexPlane.
    pub planes: f64,
    /// The weights of wide networks, and the measurement of motion in large chunks.
    pub network: f64,
    /// The pixels of a step's views.
    pub pixels: f64,
    /// The largest single buffer of the model that a device must hold: the planes, the colour coefficients of a branch,
    /// or the widest rows of the networks.
    pub largest: f64,
    /// The largest single buffer over pixels: the derivatives of SSIM.
    pub largest_of_pixels: f64,
}

impl MemoryNeed {
    /// The memory of a training run on `scene` that keeps at most `image_cache` bytes of decoded images. Nothing is
    /// drawn or decoded.
    ///
    /// # Errors
    /// If a file of initial Gaussians cannot be used.
    pub fn of(config: &Config, scene: &Scene, image_cache: u64) -> Result<Self, ModelError> {
        let [dynamic, static_] = initial_counts(scene, config)?;
        let densify = &config.densify;
        let most_static = match config.model.branches {
            Branches::Both => densify.static_.max_gaussians,
            Branches::Dynamic => 0,
        };
        let (model, motion) = (&config.model, &config.motion);
        // The hidden layers of the motion modules are twice as wide as the network in the paper.
        let width = model.width.max(motion.hidden / 2).max(motion.attention_width) as f64;
        let unit = if model.deformation { MOVING_GAUSSIAN * width } else { 0.0 };
        let of_dynamic = |count: usize| count as f64 * (STILL_GAUSSIAN + unit);
        let of_static = |count: usize| count as f64 * STILL_GAUSSIAN;
        let size = scene.train.first().map_or(0.0, |view| view.camera.width as f64 * view.camera.height as f64);
        let numbers = numbers(&config.model.grid.layout());
        let most_dynamic = densify.dynamic.max_gaussians;
        let colours = |count: usize| 4.0 * (count * rest_width(config.model.sh_degree)) as f64;
        let (of_most, pixels) = (of_dynamic(most_dynamic), PIXEL * config.train.batch_size as f64 * size);
        // Motion is measured between two steps, when their data are freed.
        let measurement = MEASUREMENT * (motion.chunk.min(most_dynamic) * motion.samples) as f64;
        // On a GPU, which alone has a largest buffer.
        let joint_rows = most_dynamic * moments_together(most_dynamic).min(config.train.batch_size);
        let weights = (width * width - PAPER_WIDTH * PAPER_WIDTH).max(0.0) * (model.depth + LAYERS) as f64;
        let parts = MemoryParts {
            static_: of_static(most_static),
            dynamic: of_most,
            planes: GRID_NUMBER * numbers,
            network: GRID_NUMBER * weights + (measurement - of_most - pixels).max(0.0),
            pixels,
            largest: colours(most_static)
                .max(colours(most_dynamic))
                .max(4.0 * numbers)
                .max(4.0 * (joint_rows * widest_row(model, motion)) as f64),
            largest_of_pixels: size * SLOPE_BYTES as f64,
        };
        let rest = parts.planes + parts.network + parts.pixels;
        Ok(Self {
            program: PROGRAM,
            pictures: pictures(scene).min(image_cache as f64),
            film: film(scene, config),
            start: rest + of_dynamic(dynamic) + of_static(static_),
            most: rest + parts.dynamic + parts.static_,
            parts,
        })
    }

    /// CPU memory that is needed on every device.
    pub fn host(&self) -> f64 {
        self.program + self.pictures + self.film
    }

    /// Settings each of which alone saves `excess` bytes of a run with this configuration, as arguments of `--set`:
    /// `train.batch_size=2`. If none does, fewer Gaussians of both branches, if that does.
    pub fn remedies(&self, config: &Config, excess: f64) -> Vec<String> {
        /// Fewer Gaussians than this are no remedy.
        const FEW: f64 = 1000.0;
        let MemoryParts { static_, dynamic, pixels, .. } = self.parts;
        let limits = [
            ("static", config.densify.static_.max_gaussians, static_),
            ("dynamic", config.densify.dynamic.max_gaussians, dynamic),
        ];
        let fewer = |&(branch, count, bytes): &(&str, usize, f64)| {
            let most = rounded_down(count as f64 * (1.0 - excess / bytes));
            (bytes > excess && most >= FEW).then(|| format!("densify.{branch}.max_gaussians={most}"))
        };
        let mut remedies: Vec<String> = limits.iter().filter_map(fewer).collect();
        if pixels > excess {
            let share = 1.0 - excess / pixels;
            let batch = (config.train.batch_size as f64 * share).floor();
            if batch >= 1.0 {
                remedies.push(format!("train.batch_size={batch}"));
            }
            // Tenths are fine enough, and sides are rounded.
            let factor = (10.0 * config.scene.downscale / share.sqrt()).ceil() / 10.0 + 0.1;
            remedies.push(format!("scene.downscale={factor:.1}"));
        }
        let share = 1.0 - excess / (static_ + dynamic);
        let [still, moving] = [limits[0].1, limits[1].1].map(|count| rounded_down(count as f64 * share));
        if remedies.is_empty() && static_ > 0.0 && still.min(moving) >= FEW {
            remedies.push(format!("densify.static.max_gaussians={still} --set densify.dynamic.max_gaussians={moving}"));
        }
        remedies
    }
}

/// Bytes per pixel of a rendered frame: both branches with their channels, blended.
const FRAME_PIXEL: f64 = 180.0;

/// Bytes per pixel and layer of a frame: the values, and the image of them.
const LAYER_PIXEL: f64 = 15.0;

/// Bytes per Gaussian and unit of the network's width in rendering, without gradients.
const RENDERED_GAUSSIAN: f64 = 30.0;

/// Channels of a branch in one buffer: colours, masks, depth and alpha, each twice, and two for each kind of motion.
const PACKED_CHANNELS: f64 = 24.0;

/// The memory of rendering frames of one size, in bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderNeed {
    /// The program and the model.
    pub model: f64,
    /// A frame with its layers.
    pub frame: f64,
    /// The largest single buffer.
    pub largest: f64,
}

impl RenderNeed {
    /// The memory of rendering a model in some number of layers, `size` in pixels.
    pub fn of(model: &Model, config: &Config, (width, height): (usize, usize), layers: usize) -> Self {
        let (pixels, still) = (width as f64 * height as f64, model.static_.as_ref().map_or(0, Gaussians::count));
        let unit = RENDERED_GAUSSIAN * config.model.width as f64;
        Self {
            model: PROGRAM + still as f64 * STILL_GAUSSIAN + model.dynamic.count() as f64 * (STILL_GAUSSIAN + unit),
            frame: pixels * (FRAME_PIXEL + LAYER_PIXEL * layers as f64),
            largest: 4.0 * PACKED_CHANNELS * pixels,
        }
    }

    /// The share of a frame's pixels that fits if only `frame` bytes are left for it.
    pub fn share(&self, frame: f64) -> f64 {
        (frame / self.frame).clamp(0.0, 1.0)
    }
}

/// A number with its first two digits, the others 0.
fn rounded_down(value: f64) -> f64 {
    let unit = 10f64.powf((value.max(1.0).log10().floor() - 1.0).max(0.0));
    (value / unit).floor() * unit
}

/// Bytes of the reduced images of fixed cameras, and of the search in them.
fn film(scene: &Scene, config: &Config) -> f64 {
    let seeds = (config.init.motion_points as f64) * SEED;
    match SceneMotion::reads_film(config).then(|| MotionFilm::need(scene, &MovingPixelsOptions::default())).flatten() {
        Some(bytes) => bytes as f64 + seeds,
        None => 0.0,
    }
}

/// Values of a row of the widest tensor in the networks: a layer, or the tokens, keys and values around a Gaussian.
fn widest_row(model: &ModelConfig, motion: &MotionConfig) -> usize {
    if !model.deformation {
        return 0;
    }
    let around = match motion.temporal {
        _ if !motion.mfta => 0,
        Temporal::Spatial => motion.neighbours,
        _ => RefinementRules::new(motion).frames.len(),
    };
    let current = usize::from(motion.include_self || motion.temporal == Temporal::SelfAttention);
    let token = token_width(model.width, motion).max(2 * motion.attention_width);
    let hidden = if motion.mvg || motion.mfta { motion.hidden } else { 0 };
    model.width.max(hidden).max((around + current) * token)
}

/// Number of values in the planes of a grid.
fn numbers(layout: &GridLayout) -> f64 {
    let [x, y, z, t] = layout.resolution.map(|cells| cells as f64);
    let of_scale = |&factor: &usize| {
        let f = factor as f64;
        f * f * (x * y + x * z + y * z) + f * t * (x + y + z)
    };
    layout.features as f64 * layout.multipliers.iter().map(of_scale).sum::<f64>()
}

/// Bytes of the decoded training images.
fn pictures(scene: &Scene) -> f64 {
    let bytes = |picture: &Picture| {
        let (width, height) = picture.size();
        f64::from(width) * f64::from(height)
    };
    scene.train.iter().map(|view| (3.0 + f64::from(u8::from(view.mask.is_some()))) * bytes(&view.image)).sum()
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;
    use crate::config::TokenMode;

    #[test]
    fn the_planes_are_counted_as_they_are_made() {
        let layout = GridLayout { features: 3, resolution: [4, 5, 6, 7], multipliers: vec![1, 2] };
        // (xy xz yz) and (xt yt zt) at both scales.
        assert_eq!(numbers(&layout), 3.0 * ((20.0 + 24.0 + 30.0) * 5.0 + 7.0 * 15.0 * 3.0));
    }

    #[test]
    fn the_widest_row_has_the_keys_and_values_of_both_neighbours() {
        let Config { model, motion, .. } = Config::default();
        assert_eq!(widest_row(&model, &motion), 2 * 2 * motion.attention_width);
        let base = MotionConfig { mvg: false, mfta: false, ..motion.clone() };
        assert_eq!(widest_row(&model, &base), model.width);
        let window = MotionConfig { tokens: TokenMode::FullWindow, ..motion };
        assert_eq!(widest_row(&model, &window), 2 * window.window * 2 * window.attention_width);
    }

    #[test]
    fn more_gaussians_and_pixels_need_more_and_pictures_no_more_than_their_budget() {
        let scene = builtin::builtin(&BuiltinOptions { width: 64, height: 48, frames: 2, ..Default::default() });
        let config = Config::default();
        let need = |config: &Config, cache| MemoryNeed::of(config, &scene, cache).expect("no files are needed");
        let whole = need(&config, u64::MAX);
        assert_eq!(whole.pictures, f64::from(3 * 64 * 48 * 14));
        assert_eq!(need(&config, 1000).pictures, 1000.0);
        assert!(whole.most > whole.start);
        let mut one = config.clone();
        one.model.branches = Branches::Dynamic;
        assert!(need(&one, 0).most < whole.most);
        let mut batch = config.clone();
        batch.train.batch_size += 3;
        let views = need(&batch, 0).start - need(&config, 0).start;
        assert!((views - 3.0 * PIXEL * 64.0 * 48.0).abs() < 1.0, "every view of a step keeps its layers");
        let mut more = config;
        more.init.static_points = 100_000;
        assert!(need(&more, 0).start > whole.start + 2e8);
    }

    #[test]
    fn each_remedy_alone_saves_what_was_asked_for() {
        let scene = builtin::builtin(&BuiltinOptions { width: 640, height: 480, frames: 2, ..Default::default() });
        let mut config = Config::default();
        config.train.batch_size = 9;
        let need = MemoryNeed::of(&config, &scene, 0).expect("no files are needed");
        let excess = 0.7 * need.parts.dynamic;
        let remedies = need.remedies(&config, excess);
        let keys = ["densify.static.max_gaussians=", "densify.dynamic.max_gaussians=", "train.batch_size="];
        assert!(keys.iter().all(|key| remedies.iter().any(|remedy| remedy.starts_with(key))), "{remedies:?}");
        for remedy in remedies {
            let (key, value) = remedy.split_once('=').expect("a setting");
            let (mut less, mut small) = (config.clone(), scene.clone());
            match key {
                "densify.static.max_gaussians" => less.densify.static_.max_gaussians = value.parse().expect("a number"),
                "densify.dynamic.max_gaussians" => {
                    less.densify.dynamic.max_gaussians = value.parse().expect("a number");
                }
                "train.batch_size" => less.train.batch_size = value.parse().expect("a number"),
                _ => {
                    let factor: f64 = value.parse().expect("a number");
                    let camera = &mut small.train[0].camera;
                    *camera = camera.resized((640.0 / factor) as usize, (480.0 / factor) as usize);
                }
            }
            let saved = need.most - MemoryNeed::of(&less, &small, 0).expect("no files are needed").most;
            assert!(saved >= excess, "{remedy} saves {saved} of {excess}");
        }
        assert!(need.remedies(&config, 1e30).is_empty());

        // More than either branch has.
        let excess = 0.9 * (need.parts.static_ + need.parts.dynamic);
        config.train.batch_size = 1;
        let both = need.remedies(&config, excess);
        let (still, moving) = both.last().and_then(|remedy| remedy.split_once(" --set ")).expect("both branches");
        let number =
            |setting: &str| setting.split_once('=').and_then(|(_, value)| value.parse().ok()).expect("a number");
        (config.densify.static_.max_gaussians, config.densify.dynamic.max_gaussians) = (number(still), number(moving));
        let less = MemoryNeed::of(&config, &scene, 0).expect("no files are needed").parts;
        assert!(need.parts.static_ + need.parts.dynamic - less.static_ - less.dynamic >= excess, "{both:?}");
    }

    #[test]
    fn the_film_of_the_search_for_motion_counts() {
        let scene = builtin::builtin(&BuiltinOptions { width: 64, height: 48, frames: 4, ..Default::default() });
        let mut config = Config::default();
        let film = |config: &Config| MemoryNeed::of(config, &scene, 0).expect("no files are needed").film;
        assert_eq!(film(&config), 0.0);
        config.init.motion_points = 100;
        let bytes = 4.0 * 64.0 * 48.0 * scene.train.len() as f64;
        assert!(film(&config) >= bytes + 1e5, "{}", film(&config));
    }
}
