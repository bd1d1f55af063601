//! The terms of the losses, unweighted, each a scalar `[1]` (METHOD §4.4).
//!
//! Means include all entries of a tensor, also where a mask is zero. Indicators have no gradient.

use burn::tensor::Tensor;
use mvfusion_render::objective::constants::ENTROPY_GUARD;
use mvfusion_render::scales::{self, ScaleRule};
use mvfusion_render::window::{self, Window};

/// Scale ratio above which a Gaussian counts as spiky.
const SPIKY_RATIO: f64 = 5.0;

/// Fraction of the extent above which a Gaussian counts as large.
const LARGE_SHARE: f64 = 0.1;

/// Mean absolute difference.
pub fn l1(a: Tensor<4>, b: Tensor<4>) -> Tensor<1> {
    (a - b).abs().mean()
}

/// `1 - SSIM` of two batches of images.
pub fn dssim(a: Tensor<4>, b: Tensor<4>, window: &Window) -> Tensor<1> {
    -window::ssim_map(a, b, window).mean() + 1.0
}

/// `mean((1 - S(a, b)) m)` with an indicator `m` `[B, 1, H, W]`.
pub fn masked_dssim(a: Tensor<4>, b: Tensor<4>, indicator: Tensor<4>, window: &Window) -> Tensor<1> {
    ((-window::ssim_map(a, b, window) + 1.0) * indicator).mean()
}

/// 1 where `values` exceed `threshold`, 0 elsewhere, without gradient.
pub fn above(values: &Tensor<4>, threshold: f64) -> Tensor<4> {
    let plain = values.clone().inner();
    let dtype = plain.dtype();
    plain.greater_elem(threshold).float().cast(dtype)
}

/// Mean distance of `front` behind `back` in extents, where the indicator `m` is 1:
/// `mean(max((front - back) / extent, 0) m)`.
pub fn behind(front: Tensor<4>, back: Tensor<4>, indicator: Tensor<4>, extent: f64) -> Tensor<1> {
    ((front - back) / extent * indicator).clamp_min(0.0).mean()
}

/// Edge-aware total variation of a depth `[B, 1, H, W]` under a photo `[B, 3, H, W]`; forward differences. Along an axis
/// of one pixel, nothing varies.
pub fn edge_variation(depth: Tensor<4>, photos: &Tensor<4>) -> Tensor<1> {
    let along = |dim: usize| {
        if depth.dims()[dim] < 2 {
            // The mean of no differences is no number.
            return (depth.clone() * 0.0).sum();
        }
        let difference = |t: &Tensor<4>| {
            let length = t.dims()[dim] - 1;
            (t.clone().narrow(dim, 1, length) - t.clone().narrow(dim, 0, length)).abs()
        };
        (difference(&depth) * (-difference(photos).mean_dim(1)).exp()).mean()
    };
    along(3) + along(2)
}

/// Structural similarity of the two branches where the mask selects the dynamic branch.
pub fn likeness(dynamic: Tensor<4>, static_: Tensor<4>, indicator: Tensor<4>, window: &Window) -> Tensor<1> {
    (window::structure_map(dynamic, static_, window) * indicator).mean()
}

/// Entropy of a mask: `-mean(p ln p + (1 - p) ln(1 - p))`.
pub fn entropy(mask: Tensor<4>) -> Tensor<1> {
    let other = -mask.clone() + 1.0;
    let part = |p: Tensor<4>| p.clone() * (p + ENTROPY_GUARD).log();
    -(part(mask) + part(other)).mean()
}

/// How much the longest axis of each Gaussian (log-scales `[N, 3]`) exceeds a tenth of the extent.
pub fn large(log_scales: Tensor<2>, extent: f64) -> Tensor<1> {
    scales::cost(log_scales, ScaleRule { large: 1.0, ..scale_rule(extent) })
}

/// How much the ratio of longest to shortest axis exceeds five.
pub fn spiky(log_scales: Tensor<2>) -> Tensor<1> {
    scales::cost(log_scales, ScaleRule { spiky: 1.0, ..scale_rule(1.0) })
}

/// What counts as large and as spiky in a scene of this extent, without weights.
pub(super) fn scale_rule(extent: f64) -> ScaleRule {
    ScaleRule { large: 0.0, large_above: LARGE_SHARE * extent, spiky: 0.0, spiky_above: SPIKY_RATIO }
}
