//! The Gaussians as the op receives them: raw parameters in row-major slices.

use mvfusion_kernels::splat::COLOUR_CHANNELS;

/// Raw parameters of `N` Gaussians and the background.
#[derive(Clone, Copy)]
pub(crate) struct Cloud<'a, T> {
    /// `[N, 3]`, world.
    pub means: &'a [T],
    /// `[N, 4]` w, x, y, z, of any length but zero.
    pub quaternions: &'a [T],
    /// `[N, 3]`.
    pub log_scales: &'a [T],
    /// `[N]`.
    pub opacity_logits: &'a [T],
    /// `[N, coefficients, 3]`.
    pub sh: &'a [T],
    /// `[N, features]`; empty without features.
    pub features: &'a [T],
    /// `[3 + features]`.
    pub background: &'a [T],
    /// Rows of `sh` for each Gaussian; those beyond the rendered degree are not read.
    pub coefficients: usize,
    /// Extra channels for each Gaussian.
    pub feature_count: usize,
}

impl<'a, T: Copy> Cloud<'a, T> {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.opacity_logits.len()
    }

    /// Blended channels: colour, features, depth.
    pub fn channels(&self) -> usize {
        COLOUR_CHANNELS + self.feature_count + 1
    }

    /// Coefficients of one Gaussian, `[coefficients, 3]`.
    pub fn sh_of(&self, index: usize) -> &'a [T] {
        &self.sh[3 * self.coefficients * index..3 * self.coefficients * (index + 1)]
    }

    /// Extra features of one Gaussian.
    pub fn features_of(&self, index: usize) -> &'a [T] {
        &self.features[self.feature_count * index..self.feature_count * (index + 1)]
    }
}

/// Three neighbouring numbers of a row-major slice.
#[inline(always)]
pub(crate) fn triple<T: Copy>(values: &[T], index: usize) -> [T; 3] {
    [values[3 * index], values[3 * index + 1], values[3 * index + 2]]
}
