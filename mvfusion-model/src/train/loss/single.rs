//! The loss of a model with one branch (4DGS, METHOD §9).

use burn::tensor::Tensor;

use super::LossContext;
use super::terms::{dssim, l1};

/// The loss without the grid's regularisers, a scalar `[1]`: L1, and D-SSIM with the weight `loss.composed_dssim`
/// (4DGS: 0). Both terms drive densification.
pub fn single_loss(picture: Tensor<4>, context: &LossContext<'_>) -> Tensor<1> {
    let (config, photos) = (context.config, context.photos.clone());
    let loss = l1(picture.clone(), photos.clone()) * config.main;
    match config.composed_dssim > 0.0 {
        true => loss + dssim(picture, photos, &context.windows.ssim) * config.composed_dssim,
        false => loss,
    }
}
