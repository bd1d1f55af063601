//! The memory that a training run will need, predicted before it starts.
//!
//! The prediction is a sum of terms that grow with the scene and the configuration: Gaussians, planes, pixels, decoded
//! images. The coefficients are from measured runs on the CPU (docs/performance.md, "Memory"), rounded up. A GPU needs
//! the same tensors.

use mvfusion_data::{Picture, Scene};
use mvfusion_render::grid::GridLayout;
use serde::Serialize;

use crate::ModelError;
use crate::config::{Branches, Config};
use crate::initial::InitialClouds;
use crate::random::Streams;

/// Bytes of the program itself, with its libraries and threads.
const PROGRAM: f64 = 80e6;

/// Bytes per static Gaussian: parameters, gradients, the optimiser's moments, projections and their adjoint.
const STILL_GAUSSIAN: f64 = 2.5e3;

/// Additional bytes per dynamic Gaussian and unit of the network's width.
const MOVING_GAUSSIAN: f64 = 94.0;

/// Bytes per value of the planes: value, gradient, the optimiser's moments and the penalties.
const GRID_NUMBER: f64 = 26.0;

/// Bytes per pixel of a step's views, which all keep their layers for the backward pass.
const PIXEL: f64 = 900.0;

/// The memory of a training run, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MemoryNeed {
    /// The program itself; in CPU memory on every device.
    pub program: f64,
    /// Decoded images; in CPU memory on every device.
    pub pictures: f64,
    /// Parameters and the data of a step, with the initial number of Gaussians.
    pub start: f64,
    /// The same with the largest number of Gaussians that the configuration allows.
    pub most: f64,
}

impl MemoryNeed {
    /// The memory of a training run on `scene` that keeps at most `image_cache` bytes of decoded images.
    ///
    /// # Errors
    /// If a file of initial Gaussians cannot be used.
    pub fn of(config: &Config, scene: &Scene, image_cache: u64) -> Result<Self, ModelError> {
        let [dynamic, static_] = initial_counts(config, scene)?;
        let densify = &config.densify;
        let most_static = match config.model.branches {
            Branches::Both => densify.static_.max_gaussians.max(static_),
            Branches::Dynamic => 0,
        };
        let network = if config.model.deformation { MOVING_GAUSSIAN * config.model.width as f64 } else { 0.0 };
        let gaussians = |dynamic: usize, static_: usize| {
            dynamic as f64 * (STILL_GAUSSIAN + network) + static_ as f64 * STILL_GAUSSIAN
        };
        let pixels = scene.train.first().map_or(0.0, |view| (view.camera.width * view.camera.height) as f64);
        let batch = config.train.batch_size as f64;
        let rest = GRID_NUMBER * numbers(&config.model.grid.layout()) + PIXEL * batch * pixels;
        Ok(Self {
            program: PROGRAM,
            pictures: pictures(scene).min(image_cache as f64),
            start: rest + gaussians(dynamic, static_),
            most: rest + gaussians(densify.dynamic.max_gaussians.max(dynamic), most_static),
        })
    }
}

/// Numbers of dynamic and static Gaussians before the first step.
fn initial_counts(config: &Config, scene: &Scene) -> Result<[usize; 2], ModelError> {
    let clouds = InitialClouds::draw(scene, None, config, &mut Streams::new(config.seed).clouds)?;
    Ok([clouds.dynamic.len(), clouds.static_.map_or(0, |cloud| cloud.len())])
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

    #[test]
    fn the_planes_are_counted_as_they_are_made() {
        let layout = GridLayout { features: 3, resolution: [4, 5, 6, 7], multipliers: vec![1, 2] };
        // (xy xz yz) and (xt yt zt) at both scales.
        assert_eq!(numbers(&layout), 3.0 * ((20.0 + 24.0 + 30.0) * 5.0 + 7.0 * 15.0 * 3.0));
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
}
