//! The Gaussians as raw parameters in row-major slices.

use crate::splat::tensors::{SplatSizes, SplatTensors};

/// Raw parameters of `N` Gaussians and the background.
#[derive(Clone, Copy)]
pub(crate) struct Cloud<'a, T> {
    /// The values of the op's tensors; without features, `features` is not read.
    pub values: SplatTensors<&'a [T]>,
    /// The sizes of the tensors.
    pub sizes: SplatSizes,
}

impl<'a, T: Copy> Cloud<'a, T> {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.sizes.count
    }

    /// Blended channels: colour, features, depth.
    pub fn channels(&self) -> usize {
        self.sizes.channels()
    }

    /// Extra features of one Gaussian.
    pub fn features_of(&self, index: usize) -> &'a [T] {
        let columns = self.sizes.features;
        &self.values.features[columns * index..columns * (index + 1)]
    }
}
