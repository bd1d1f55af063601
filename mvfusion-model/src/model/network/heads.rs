//! The heads: offsets of each attribute from a feature (METHOD §2.3, §2.4).

use std::ops::Add;

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;

use super::{Mlp, ModuleInit, Rectified, side_by_side};
use crate::model::mask::MaskChannel;

/// Number of deformed colour coefficients: degree 3, three channels.
const SH_OUTPUTS: usize = 48;

/// Number of mask logits.
const MASK_OUTPUTS: usize = MaskChannel::ALL.len();

/// An attribute that has a head, in the order of [`Offsets::joined`].
#[derive(Clone, Copy, Debug)]
enum Attribute {
    Means,
    LogScales,
    Quaternions,
    OpacityLogits,
    Sh,
    MaskLogits,
}

/// The heads of a network other than those for centres, log-scales and quaternions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeadChoice {
    /// Head of the opacity logits.
    pub opacity: bool,
    /// Head of the colour coefficients.
    pub sh: bool,
    /// The three mask heads, for two blended branches (DeGauss).
    pub masks: bool,
}

impl HeadChoice {
    /// Every head, as in DeGauss.
    pub const ALL: Self = Self { opacity: true, sh: true, masks: true };
}

impl HeadChoice {
    /// Number of outputs of the heads per Gaussian; 62 with all heads.
    pub fn outputs(self) -> usize {
        self.widths().iter().sum()
    }

    /// Number of outputs for each attribute, in the order of [`Offsets::joined`]; 0 without a head.
    pub(crate) fn widths(self) -> [usize; 6] {
        let of = |there: bool, outputs: usize| if there { outputs } else { 0 };
        [3, 3, 4, of(self.opacity, 1), of(self.sh, SH_OUTPUTS), of(self.masks, MASK_OUTPUTS)]
    }
}

/// Offsets of the raw attributes of the dynamic Gaussians, as the heads give them: side by side in one matrix.
#[derive(Clone, Debug)]
pub struct Offsets {
    joined: Tensor<2>,
    heads: HeadChoice,
}

impl Offsets {
    /// Centres, in world units: `[N, 3]`.
    pub fn means(&self) -> Tensor<2> {
        self.columns(Attribute::Means)
    }

    /// Log-scales: `[N, 3]`.
    pub fn log_scales(&self) -> Tensor<2> {
        self.columns(Attribute::LogScales)
    }

    /// Quaternions, component-wise: `[N, 4]`.
    pub fn quaternions(&self) -> Tensor<2> {
        self.columns(Attribute::Quaternions)
    }

    /// Opacity logits: `[N, 1]`; absent if they do not change.
    pub fn opacity_logits(&self) -> Option<Tensor<2>> {
        self.heads.opacity.then(|| self.columns(Attribute::OpacityLogits))
    }

    /// Colour coefficients, coefficient by coefficient, colour fastest: `[N, 48]`; absent if they do not change.
    pub fn sh(&self) -> Option<Tensor<2>> {
        self.heads.sh.then(|| self.columns(Attribute::Sh))
    }

    /// Mask logits, one column per [`MaskChannel`]: `[N, 3]`; absent without mask heads.
    pub fn mask_logits(&self) -> Option<Tensor<2>> {
        self.heads.masks.then(|| self.columns(Attribute::MaskLogits))
    }

    /// All offsets, `[N, outputs]`: centres, log-scales, quaternions, opacity, colour, mask logits. Absent heads leave no
    /// gap.
    pub fn joined(self) -> Tensor<2> {
        self.joined
    }

    /// Which heads there are besides those for centres, log-scales and quaternions.
    pub fn heads(&self) -> HeadChoice {
        self.heads
    }

    /// These offsets, but the mask logits of others.
    pub(crate) fn with_masks_of(self, other: &Self) -> Self {
        match other.mask_logits() {
            Some(masks) => {
                let kept = self.joined.clone().narrow(1, 0, self.first_column(Attribute::MaskLogits));
                Self { joined: Tensor::cat(vec![kept, masks], 1), ..self }
            }
            None => self,
        }
    }

    /// The columns of an attribute.
    fn columns(&self, attribute: Attribute) -> Tensor<2> {
        self.joined.clone().narrow(1, self.first_column(attribute), self.heads.widths()[attribute as usize])
    }

    fn first_column(&self, attribute: Attribute) -> usize {
        self.heads.widths()[..attribute as usize].iter().sum()
    }
}

impl Add for Offsets {
    type Output = Self;

    /// The sums of the offsets of the same heads.
    fn add(self, other: Self) -> Self {
        Self { joined: self.joined + other.joined, ..self }
    }
}

/// The attribute heads, each ReLU, linear, ReLU, linear.
#[derive(Module, Debug)]
pub struct AttributeHeads {
    /// Centres.
    pub means: Mlp,
    /// Log-scales.
    pub log_scales: Mlp,
    /// Quaternions.
    pub quaternions: Mlp,
    /// Opacity logits.
    pub opacity_logits: Option<Mlp>,
    /// Colour coefficients.
    pub sh: Option<Mlp>,
}

/// The three mask heads, each one layer deeper than an attribute head.
#[derive(Module, Debug)]
pub struct MaskHeads {
    /// Logit of the static background (`light_deform_dy`).
    pub static_: Mlp,
    /// Logit of the brightness control (`light_deform`).
    pub brightness: Mlp,
    /// Logit of the dynamic foreground (`mask_deform`).
    pub dynamic: Mlp,
}

impl AttributeHeads {
    /// Heads on a feature of the given width.
    pub fn new(width: usize, choice: HeadChoice, init: &mut ModuleInit<'_>) -> Self {
        Self {
            means: init.mlp(&[width, width, 3]),
            log_scales: init.mlp(&[width, width, 3]),
            quaternions: init.mlp(&[width, width, 4]),
            opacity_logits: choice.opacity.then(|| init.mlp(&[width, width, 1])),
            sh: choice.sh.then(|| init.mlp(&[width, width, SH_OUTPUTS])),
        }
    }

    /// Only the offsets of centres, log-scales and quaternions, concatenated: `[N, 10]`. The feature `[N, width]` is
    /// taken before its ReLU.
    pub fn geometry(&self, feature: Tensor<2>) -> Tensor<2> {
        let chains = self.geometry_chains().map(|chain| &*chain.layers);
        side_by_side(&chains, feature, Rectified::Yes)
    }

    fn geometry_chains(&self) -> [&Mlp; 3] {
        [&self.means, &self.log_scales, &self.quaternions]
    }

    /// The MLPs in the order of [`Offsets`].
    fn chains(&self) -> impl Iterator<Item = &Mlp> {
        self.geometry_chains().into_iter().chain(&self.opacity_logits).chain(&self.sh)
    }
}

impl MaskHeads {
    /// Heads on a feature of the given width.
    pub fn new(width: usize, init: &mut ModuleInit<'_>) -> Self {
        Self {
            static_: init.mlp(&[width, width, width, 1]),
            brightness: init.mlp(&[width, width, width, 1]),
            dynamic: init.mlp(&[width, width, width, 1]),
        }
    }

    fn chains(&self) -> [&Mlp; 3] {
        MaskChannel::ALL.map(|channel| match channel {
            MaskChannel::Static => &self.static_,
            MaskChannel::Brightness => &self.brightness,
            MaskChannel::Dynamic => &self.dynamic,
        })
    }
}

/// All offsets of a feature `[N, width]`, taken before its ReLU.
pub(super) fn decode(feature: Tensor<2>, heads: &AttributeHeads, masks: Option<&MaskHeads>) -> Offsets {
    let chains = heads.chains().chain(masks.iter().flat_map(|masks| masks.chains()));
    let chains: Vec<&[Linear]> = chains.map(|chain| &*chain.layers).collect();
    let choice = HeadChoice { opacity: heads.opacity_logits.is_some(), sh: heads.sh.is_some(), masks: masks.is_some() };
    Offsets { joined: side_by_side(&chains, feature, Rectified::Yes), heads: choice }
}
