//! The LPIPS distance of a pair of images: a map for each stage of the network.

use burn::tensor::Tensor;
use burn::tensor::module::interpolate;
use burn::tensor::ops::{InterpolateMode, InterpolateOptions};

/// The distance of two images by stage: maps `[1, 1, h, w]`, each with the size of its stage's features.
#[derive(Clone, Debug)]
pub struct Distance {
    pub(super) maps: Vec<Tensor<4>>,
}

impl Distance {
    /// Mean of each stage's map, each `[1]`.
    pub fn stages(&self) -> impl Iterator<Item = Tensor<1>> {
        self.maps.iter().map(|map| map.clone().mean())
    }

    /// LPIPS, `[1]`: the sum of the stages' means. Gradients reach both images.
    pub fn value(&self) -> Tensor<1> {
        // Proof: only `Lpips::distances` creates distances, with a map per stage, and every network has stages.
        self.stages().reduce(|sum, stage| sum + stage).expect("a network has stages")
    }

    /// The sum of the stages' maps at the size of the images, `[1, 1, H, W]`: bilinear, with aligned pixel centres
    /// (`spatial=True` of the package lpips).
    pub fn spatial(&self, size: [usize; 2]) -> Tensor<4> {
        let options = InterpolateOptions::new(InterpolateMode::Bilinear).with_align_corners(false);
        let large = |map: &Tensor<4>| match map.dims() == [1, 1, size[0], size[1]] {
            true => map.clone(),
            false => interpolate(map.clone(), options.clone().with_output_size(size)),
        };
        // Proof: only `Lpips::distances` creates distances, with a map per stage, and every network has stages.
        self.maps.iter().map(large).reduce(|sum, map| sum + map).expect("a network has stages")
    }
}
