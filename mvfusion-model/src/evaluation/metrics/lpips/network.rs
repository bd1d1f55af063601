//! The networks of LPIPS as Burn modules.

use std::ops::Range;

use burn::module::{Module, Param};
use burn::nn::conv::Conv2d;
use burn::nn::pool::MaxPool2d;
use burn::tensor::activation::relu;
use burn::tensor::{Tensor, TensorData};
use mvfusion_render::device::is_gpu;
use rayon::prelude::*;

use super::distance::Distance;
use super::layout::InputRange;
use crate::tensors;

/// Mean and deviation per channel of the networks' training data, in `[-1, 1]`.
const MEAN: [f64; 3] = [-0.030, -0.088, -0.188];
const DEVIATION: [f64; 3] = [0.458, 0.448, 0.450];

/// Added to the norm of a pixel's features, so that it is not zero.
const SHORTEST: f64 = 1e-10;

/// Bytes of features that a stage computes at once, for all its images. The convolutions need a few times as much. The
/// first stage of VGG has 350 MB of features for one image of 1352 x 1014.
const BAND_BYTES: usize = 64 << 20;

/// A network with the weights of its stages.
#[derive(Module, Debug)]
pub struct Lpips {
    /// First to last.
    pub(super) stages: Vec<Stage>,
}

/// Convolutions, each followed by a ReLU; the comparison of their last output; the pooling before the next stage.
#[derive(Module, Debug)]
pub(super) struct Stage {
    /// First to last.
    pub(super) convolutions: Vec<Conv2d>,
    /// Weight of each channel's squared difference, `[1, C, 1, 1]`.
    pub(super) weight: Param<Tensor<4>>,
    /// `None` after the last stage.
    pub(super) pool: Option<MaxPool2d>,
}

/// The output of a stage for some rows.
struct Output {
    /// A map `[1, 1, h, W]` for each pair.
    maps: Vec<Tensor<4>>,
    /// The input of the next stage.
    pooled: Tensor<4>,
}

impl Lpips {
    /// Compares pairs of the images `[K, 3, H, W]` in `[0, 1]`, given by their indices. Each image passes through the
    /// network once. A stage's features are dropped before the next stage, and features of large images are computed in
    /// bands of rows. Memory therefore stays at a few hundred megabytes.
    ///
    /// `None` for images that are too small for the network: a side of less than 31 pixels for AlexNet, 16 for VGG-16.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn distances(&self, pictures: Tensor<4>, range: InputRange, pairs: &[(usize, usize)]) -> Option<Vec<Distance>> {
        let [_, _, height, width] = pictures.dims();
        if !self.fits(height) || !self.fits(width) {
            return None;
        }
        let mut distances = vec![Distance { maps: Vec::new() }; pairs.len()];
        let mut features = normalised(pictures, range);
        for stage in &self.stages {
            let output = stage.forward(features, pairs, BAND_BYTES);
            for (distance, map) in distances.iter_mut().zip(output.maps) {
                distance.maps.push(map);
            }
            features = output.pooled;
        }
        Some(distances)
    }

    /// Whether images with this side length have features at the last stage.
    fn fits(&self, side: usize) -> bool {
        let mut left = Some(side);
        for stage in &self.stages {
            for convolution in &stage.convolutions {
                let [kernel, stride, padding] = along_rows(convolution);
                left = left.and_then(|side| windows(side + 2 * padding, kernel, stride));
            }
            if left.is_none_or(|side| side == 0) {
                return false;
            }
            if let Some(pool) = &stage.pool {
                left = left.and_then(|side| windows(side, pool.kernel_size[0], pool.stride[0]));
            }
        }
        true
    }
}

/// Number of windows along a side; `None` if no window fits.
fn windows(side: usize, kernel: usize, stride: usize) -> Option<usize> {
    side.checked_sub(kernel).map(|room| room / stride + 1)
}

/// Kernel, stride and padding of a convolution, which are equal along both sides.
fn along_rows(convolution: &Conv2d) -> [usize; 3] {
    // Proof: `Lpips::build` creates every convolution with explicit padding.
    let burn::nn::PaddingConfig2d::Explicit(padding, ..) = convolution.padding else {
        unreachable!("paddings are explicit")
    };
    [convolution.kernel_size[0], convolution.stride[0], padding]
}

/// Images in `[0, 1]`, normalised for the network.
fn normalised(pictures: Tensor<4>, range: InputRange) -> Tensor<4> {
    let fed = match range {
        InputRange::Signed => pictures * 2.0 - 1.0,
        InputRange::Raw => pictures,
    };
    let channels =
        |values: [f64; 3]| tensors::from_data_like::<4, 4>(TensorData::new(values.to_vec(), [1, 3, 1, 1]), &fed);
    let (mean, deviation) = (channels(MEAN), channels(DEVIATION));
    (fed - mean) / deviation
}

impl Stage {
    /// The output for features `[K, C, H, W]`, computed in bands of rows of at most `budget` bytes each, if possible.
    fn forward(&self, features: Tensor<4>, pairs: &[(usize, usize)], budget: usize) -> Output {
        let [count, _, height, width] = features.dims();
        let row_bytes = 4 * count * width * self.weight.dims()[1];
        let Some(reach) = self.reach().filter(|_| row_bytes * height > budget) else {
            return self.band(&features, 0..height, 0, pairs);
        };
        let mut maps: Vec<Vec<Tensor<4>>> = vec![Vec::new(); pairs.len()];
        let mut pooled = Vec::new();
        for rows in bands(height, budget / row_bytes) {
            let band = self.band(&features, rows, reach, pairs);
            for (maps, map) in maps.iter_mut().zip(band.maps) {
                maps.push(map);
            }
            pooled.push(band.pooled);
        }
        Output { maps: maps.into_iter().map(|maps| Tensor::cat(maps, 2)).collect(), pooled: Tensor::cat(pooled, 2) }
    }

    /// The outputs of `rows`, computed from these and `reach` rows around them. At the edge of the image, the zero
    /// padding is correct. At the edge of a band, rows within `reach`, which the padding affects, are dropped.
    fn band(&self, features: &Tensor<4>, rows: Range<usize>, reach: usize, pairs: &[(usize, usize)]) -> Output {
        let height = features.dims()[2];
        let seen = rows.start.saturating_sub(reach)..(rows.end + reach).min(height);
        let mut output = match seen == (0..height) {
            true => features.clone(),
            false => features.clone().narrow(2, seen.start, seen.len()),
        };
        output = self.convolve(output);
        if seen != rows {
            output = output.narrow(2, rows.start - seen.start, rows.len());
        }
        Output { maps: self.compare(&output, pairs), pooled: self.pool(output) }
    }

    /// The convolutions of features `[K, C, H, W]`. On a CPU, images run in parallel, because Burn's convolutions
    /// rearrange their input on a single thread.
    fn convolve(&self, features: Tensor<4>) -> Tensor<4> {
        let through = |features: Tensor<4>| {
            self.convolutions.iter().fold(features, |features, convolution| relu(convolution.forward(features)))
        };
        if is_gpu(&features.device()) {
            return through(features);
        }
        let count = features.dims()[0];
        let pictures: Vec<Tensor<4>> = features.chunk(count, 0);
        Tensor::cat(pictures.into_par_iter().map(through).collect(), 0)
    }

    /// Squared differences of unit-length features, weighted and summed over channels.
    fn compare(&self, features: &Tensor<4>, pairs: &[(usize, usize)]) -> Vec<Tensor<4>> {
        let length = features.clone().square().sum_dim(1).sqrt() + SHORTEST;
        let unit = features.clone() / length;
        let of = |index: usize| unit.clone().narrow(0, index, 1);
        pairs.iter().map(|&(a, b)| ((of(a) - of(b)).square() * self.weight.val()).sum_dim(1)).collect()
    }

    fn pool(&self, features: Tensor<4>) -> Tensor<4> {
        match &self.pool {
            Some(pool) => pool.forward(features),
            None => features,
        }
    }

    /// Number of rows above and below on which an output row depends. `None` if the stage cannot be computed in bands
    /// that start at even rows: its convolutions must keep the size, and no pooling window may span two bands.
    fn reach(&self) -> Option<usize> {
        let keeps = |convolution: &Conv2d| {
            let [kernel, stride, padding] = along_rows(convolution);
            (stride == 1 && kernel == 2 * padding + 1).then_some(padding)
        };
        let pools_apart = self.pool.as_ref().is_none_or(|pool| pool.kernel_size == [2, 2] && pool.stride == [2, 2]);
        let reach = self.convolutions.iter().map(keeps).sum::<Option<usize>>();
        reach.filter(|_| pools_apart)
    }
}

/// Rows `0..height` in bands of about `rows`: an even number, for the pooling, and at least two in the last band.
fn bands(height: usize, rows: usize) -> Vec<Range<usize>> {
    let rows = (rows / 2 * 2).max(2);
    let mut starts: Vec<usize> = (0..height).step_by(rows).collect();
    if height % rows == 1 && starts.len() > 1 {
        starts.pop();
    }
    let ends = starts.iter().skip(1).copied().chain([height]);
    starts.iter().copied().zip(ends).map(|(start, end)| start..end).collect()
}

#[cfg(test)]
mod tests;
