//! The raw attributes of Gaussians at one time: what is deformed and rendered.

use burn::tensor::{Int, Tensor};
use mvfusion_render::activation::{self, sigmoid};
use mvfusion_render::offsets;

use super::attribute::Attribute;
use crate::model::mask::MaskChannel;
use crate::model::network::{HeadChoice, Offsets};

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
    ///
    /// # Panics
    /// If there are not as many offsets.
    pub fn deformed(self, offsets: Offsets) -> Self {
        // Proof: there is a result for each set.
        Self::deformed_each(vec![self], offsets).pop().expect("one")
    }

    /// The same for sets of Gaussians, whose offsets follow one another.
    pub(crate) fn deformed_each(sets: Vec<Self>, offsets: Offsets) -> Vec<Self> {
        let heads = offsets.heads();
        let widths: Vec<usize> = heads.widths().into_iter().filter(|&width| width > 0).collect();
        let attributes = sets.iter().map(|set| set.of_heads(heads)).collect();
        let sums = offsets::add(attributes, offsets.joined(), &widths);
        sets.into_iter().zip(sums).map(|(set, sums)| set.with(heads, sums)).collect()
    }

    /// The attributes that heads deform, in the order of [`Offsets::joined`].
    fn of_heads(&self, heads: HeadChoice) -> Vec<Tensor<2>> {
        let [count, coefficients, channels] = self.sh.dims();
        let geometry = [&self.means, &self.log_scales, &self.quaternions].map(Tensor::clone);
        let opacity = heads.opacity.then(|| self.opacity_logits.clone());
        let sh = heads.sh.then(|| self.sh.clone().reshape([count, coefficients * channels]));
        let masks = self.mask_logits.clone().filter(|_| heads.masks);
        geometry.into_iter().chain(opacity).chain(sh).chain(masks).collect()
    }

    /// These Gaussians with other values of the attributes of [`RawGaussians::of_heads`].
    fn with(self, heads: HeadChoice, attributes: Vec<Tensor<2>>) -> Self {
        let mut attributes = attributes.into_iter();
        // Proof: each head's attribute has a sum.
        let mut next = || attributes.next().expect("an attribute");
        let shape = self.sh.dims();
        Self {
            means: next(),
            log_scales: next(),
            quaternions: next(),
            opacity_logits: if heads.opacity { next() } else { self.opacity_logits },
            sh: if heads.sh { next().reshape(shape) } else { self.sh },
            mask_logits: self.mask_logits.map(|logits| if heads.masks { next() } else { logits }),
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
