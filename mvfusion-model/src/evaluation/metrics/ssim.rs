//! Structural similarity: one map, of which the field takes two means.

use burn::tensor::Tensor;
use mvfusion_render::window::{self, Window};

use super::PixelMap;
use crate::ModelError;

/// Pixels on each side whose window reaches beyond the picture: half of the 11-pixel window.
pub const SSIM_BORDER: usize = 5;

/// The SSIM of two pictures `[1, 3, H, W]` in `[0, 1]` at each channel and pixel: 11-pixel Gaussian window of sigma
/// 1.5, zeros outside the pictures.
///
/// The mean of the map is the SSIM of 3DGS and its descendants. The mean without [`SSIM_BORDER`] is that of
/// scikit-image (`gaussian_weights`, `sigma=1.5`, `use_sample_covariance=False`, `data_range=1`), of torchmetrics,
/// which reflects the picture at its border and then crops as much, and of nerfbaselines. They differ in the third
/// decimal.
///
/// # Errors
/// If the device cannot hand its numbers back.
pub fn ssim_map(picture: Tensor<4>, reference: Tensor<4>) -> Result<PixelMap, ModelError> {
    PixelMap::read(window::ssim_map(picture, reference, &Window::gaussian(11, 1.5)))
}
