//! The metrics of one layer.

use serde::{Deserialize, Serialize};

/// Metrics of a layer, or of a region of it. An unknown metric is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LayerScores {
    /// Mean PSNR in dB, of 8-bit images.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub psnr: Option<f64>,
    /// Mean PSNR in dB without the 8-bit round trip.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub psnr_exact: Option<f64>,
    /// Mean SSIM as in 3DGS, with zeros outside the image.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ssim: Option<f64>,
    /// Mean SSIM as in scikit-image, without the 5 outermost pixels of the image, also for a region.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ssim_valid: Option<f64>,
    /// Mean MS-SSIM; only for whole images with more than 160 pixels per side.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ms_ssim: Option<f64>,
    /// Mean D-SSIM, `(1 - MS-SSIM) / 2`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub d_ssim: Option<f64>,
    /// Mean LPIPS with AlexNet on `[-1, 1]`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_alex: Option<f64>,
    /// Mean LPIPS with VGG-16 on `[-1, 1]`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_vgg: Option<f64>,
    /// Mean LPIPS with AlexNet on `[0, 1]`, as in the code of 3DGS' successors.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_alex_raw: Option<f64>,
    /// Mean LPIPS with VGG-16 on `[0, 1]`, as in the code of 3DGS.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_vgg_raw: Option<f64>,
}
