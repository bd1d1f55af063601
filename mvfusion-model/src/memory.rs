//! How much memory a training will need, told before it begins.
//!
//! A sum of what grows with the scene and the configuration: Gaussians, planes, pixels, decoded pictures. The shares are
//! those of measured runs on the CPU (docs/performance.md, "Memory"), rounded up; a GPU holds the same tensors.

use mvfusion_data::{Picture, Scene};
use mvfusion_render::grid::GridLayout;
use serde::Serialize;

use crate::ModelError;
use crate::config::{Branches, Config};
use crate::initial::InitialClouds;
use crate::random::Streams;

/// The program itself with its libraries and threads.
const PROGRAM: f64 = 80e6;

/// A Gaussian that does not move: parameters, gradients, the optimiser's moments, projections and their adjoint.
const STILL_GAUSSIAN: f64 = 2.5e3;

/// What a Gaussian that moves needs beyond that, for each unit of the network's width.
const MOVING_GAUSSIAN: f64 = 94.0;

/// A number of the planes: itself, its gradient, the optimiser's moments and what the penalties need.
const GRID_NUMBER: f64 = 26.0;

/// A pixel of one of the views that are rendered for a step: all of them keep their layers for the backward pass.
const PIXEL: f64 = 900.0;

/// The memory of a training, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MemoryNeed {
    /// The program itself; on the CPU whatever the device.
    pub program: f64,
    /// Decoded pictures; on the CPU whatever the device.
    pub pictures: f64,
    /// Parameters and what a step computes, with the Gaussians that training starts from.
    pub start: f64,
    /// The same with as many Gaussians as the configuration allows.
    pub most: f64,
}

impl MemoryNeed {
    /// The need of a training on `scene` that keeps at most `image_cache` bytes of decoded pictures.
    ///
    /// # Errors
    /// If a file of Gaussians to start from cannot be used.
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

/// Numbers in the planes of a grid.
fn numbers(layout: &GridLayout) -> f64 {
    let [x, y, z, t] = layout.resolution.map(|cells| cells as f64);
    let of_scale = |&factor: &usize| {
        let f = factor as f64;
        f * f * (x * y + x * z + y * z) + f * t * (x + y + z)
    };
    layout.features as f64 * layout.multipliers.iter().map(of_scale).sum::<f64>()
}

/// Bytes of the training pictures once they are decoded.
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
