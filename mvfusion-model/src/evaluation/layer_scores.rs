//! The metrics of one layer.

use serde::{Deserialize, Serialize};

/// Metrics of a layer, or of a region of it. A metric that is not known is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LayerScores {
    /// Mean PSNR in dB, of 8-bit pictures.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub psnr: Option<f64>,
    /// Mean PSNR in dB without the 8-bit round trip.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub psnr_exact: Option<f64>,
    /// Mean SSIM as 3DGS computes it: zeros outside the picture.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ssim: Option<f64>,
    /// Mean SSIM as scikit-image computes it: without the 5 outermost pixels of the picture, also in a part of it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ssim_valid: Option<f64>,
    /// Mean MS-SSIM; pictures of more than 160 pixels a side have one, parts of them have none.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub ms_ssim: Option<f64>,
    /// Mean D-SSIM, `(1 - MS-SSIM) / 2`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub d_ssim: Option<f64>,
    /// Mean LPIPS by AlexNet on `[-1, 1]`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_alex: Option<f64>,
    /// Mean LPIPS by VGG-16 on `[-1, 1]`.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_vgg: Option<f64>,
    /// Mean LPIPS by AlexNet on `[0, 1]`, as the code of 3DGS' descendants prints it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_alex_raw: Option<f64>,
    /// Mean LPIPS by VGG-16 on `[0, 1]`, as the code of 3DGS prints it.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_vgg_raw: Option<f64>,
}
