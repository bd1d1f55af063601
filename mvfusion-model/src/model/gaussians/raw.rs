//! The raw attributes of Gaussians at one time: what is deformed and rendered.

use burn::tensor::{Int, Tensor};
use mvfusion_render::activation::{self, sigmoid};

use super::attribute::Attribute;
use crate::model::mask::MaskChannel;
use crate::model::network::Offsets;

/// The colour of a Gaussian at SH degree 0 is `0.5 + SH_C0 * dc`.
pub const SH_C0: f64 = 0.282_094_791_773_878_14;

/// Raw attributes as tensors for rendering, canonical or deformed.
#[derive(Clone, Debug)]
pub struct RawGaussians {
    /// Centres: `[N, 3]`.
    pub means: Tensor<2>,
    /// Colour coefficients: `[N, K, 3]`.
    pub sh: Tensor<3>,
    /// Opacity logits: `[N, 1]`.
    pub opacity_logits: Tensor<2>,
    /// Log-scales: `[N, 3]`.
    pub log_scales: Tensor<2>,
    /// Quaternions: `[N, 4]`.
    pub quaternions: Tensor<2>,
    /// Mask logits, one column per [`MaskChannel`]: `[N, 3]`.
    pub mask_logits: Option<Tensor<2>>,
}

impl RawGaussians {
    /// The Gaussians plus `offsets`, all in raw units (METHOD §2.3).
    pub fn deformed(self, offsets: Offsets) -> Self {
        let [count, coefficients, _] = self.sh.dims();
        let sh_offsets =
            offsets.sh.map(|offsets| offsets.narrow(1, 0, coefficients * 3).reshape([count, coefficients, 3]));
        Self {
            means: self.means + offsets.means,
            sh: plus(self.sh, sh_offsets),
            opacity_logits: plus(self.opacity_logits, offsets.opacity_logits),
            log_scales: self.log_scales + offsets.log_scales,
            quaternions: self.quaternions + offsets.quaternions,
            mask_logits: self.mask_logits.map(|logits| plus(logits, offsets.mask_logits)),
        }
    }

    /// Splat features: mask probabilities, one column per [`MaskChannel`]: `[N, 3]` (METHOD §1.2).
    pub fn mask_features(&self) -> Option<Tensor<2>> {
        Some(sigmoid(self.mask_logits.clone()?))
    }

    /// Foreground probability of each Gaussian: `clamp(u_d / (u_d + u_s)) * opacity`, `[N, 1]` (METHOD §1.4).
    pub fn foreground_probability(&self) -> Option<Tensor<2>> {
        Some(foreground_share(self.mask_logits.clone()?.inner()) * sigmoid(self.opacity_logits.clone().inner()))
    }

    /// The values of an attribute in the layout of [`Gaussians`](super::Gaussians).
    pub fn attribute(&self, attribute: Attribute) -> Option<Tensor<2>> {
        let sh = |first: usize, end: usize| {
            let count = self.sh.dims()[0];
            self.sh.clone().narrow(1, first, end - first).reshape([count, 3 * (end - first)])
        };
        Some(match attribute {
            Attribute::Means => self.means.clone(),
            Attribute::ShDc => sh(0, 1),
            Attribute::ShRest => sh(1, self.sh.dims()[1]),
            Attribute::OpacityLogits => self.opacity_logits.clone(),
            Attribute::LogScales => self.log_scales.clone(),
            Attribute::Quaternions => self.quaternions.clone(),
            Attribute::MaskLogits => return self.mask_logits.clone(),
            Attribute::TimeCentres | Attribute::LogDurations | Attribute::Velocities => return None,
        })
    }

    /// The rows of the given Gaussians.
    pub fn select(self, rows: &Tensor<1, Int>) -> Self {
        Self {
            means: self.means.select(0, rows.clone()),
            sh: self.sh.select(0, rows.clone()),
            opacity_logits: self.opacity_logits.select(0, rows.clone()),
            log_scales: self.log_scales.select(0, rows.clone()),
            quaternions: self.quaternions.select(0, rows.clone()),
            mask_logits: self.mask_logits.map(|logits| logits.select(0, rows.clone())),
        }
    }
}

/// Share of the foreground in the mask of each Gaussian: `[N, 1]`, without a gradient (METHOD §1.4).
pub(super) fn foreground_share(mask_logits: Tensor<2>) -> Tensor<2> {
    activation::foreground_share(
        mask_logits,
        [MaskChannel::Static, MaskChannel::Dynamic].map(|channel| channel as usize),
    )
}

/// Values plus offsets, if there are any.
fn plus<const D: usize>(values: Tensor<D>, offsets: Option<Tensor<D>>) -> Tensor<D> {
    match offsets {
        Some(offsets) => values + offsets,
        None => values,
    }
}
