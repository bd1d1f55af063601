//! SSIM: one map with two common means.

use burn::tensor::Tensor;
use mvfusion_render::window::{self, Window};

use super::PixelMap;
use crate::ModelError;

/// Pixels on each side whose window extends beyond the image: half of the 11-pixel window.
pub const SSIM_BORDER: usize = 5;

/// The SSIM of two images `[1, 3, H, W]` in `[0, 1]` at each channel and pixel, with an 11-pixel Gaussian window of
/// sigma 1.5 and zeros outside the images.
///
/// The mean of the map is the SSIM of 3DGS and its successors. The mean without [`SSIM_BORDER`] is the SSIM of
/// scikit-image (`gaussian_weights`, `sigma=1.5`, `use_sample_covariance=False`, `data_range=1`) and nerfbaselines. It
/// also equals the SSIM of torchmetrics, which reflects the image at its border and then crops the same width. Both
/// means differ in the third decimal.
///
/// # Errors
/// If the device fails to return values.
pub fn ssim_map(picture: Tensor<4>, reference: Tensor<4>) -> Result<PixelMap, ModelError> {
    PixelMap::read(window::ssim_map(picture, reference, &Window::gaussian(11, 1.5)))
}
