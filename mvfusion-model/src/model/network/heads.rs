//! The heads: offsets of each attribute from a feature (METHOD §2.3, §2.4).

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::Tensor;
use mvfusion_render::blocks::apart;

use super::{Mlp, ModuleInit, Rectified, side_by_side};
use crate::model::mask::MaskChannel;

/// Number of values of centre, log-scale and quaternion.
const GEOMETRY_OUTPUTS: usize = 10;

/// Number of deformed colour coefficients: degree 3, three channels.
const SH_OUTPUTS: usize = 48;

/// Number of mask logits.
const MASK_OUTPUTS: usize = MaskChannel::ALL.len();

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
        let of = |there: bool, outputs: usize| if there { outputs } else { 0 };
        GEOMETRY_OUTPUTS + of(self.opacity, 1) + of(self.sh, SH_OUTPUTS) + of(self.masks, MASK_OUTPUTS)
    }
}

/// Offsets of the raw attributes of the dynamic Gaussians.
#[derive(Clone, Debug)]
pub struct Offsets {
    /// Centres, in world units: `[N, 3]`.
    pub means: Tensor<2>,
    /// Log-scales: `[N, 3]`.
    pub log_scales: Tensor<2>,
    /// Quaternions, component-wise: `[N, 4]`.
    pub quaternions: Tensor<2>,
    /// Opacity logits: `[N, 1]`; absent if they do not change.
    pub opacity_logits: Option<Tensor<2>>,
    /// Colour coefficients, coefficient by coefficient, colour fastest: `[N, 48]`; absent if they do not change.
    pub sh: Option<Tensor<2>>,
    /// Mask logits, one column per [`MaskChannel`]: `[N, 3]`; absent without mask heads.
    pub mask_logits: Option<Tensor<2>>,
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

/// All offsets of a feature `[N, width]`, taken before its ReLU: one after the other, those of the given numbers of rows.
pub(super) fn decode(
    feature: Tensor<2>,
    counts: &[usize],
    heads: &AttributeHeads,
    masks: Option<&MaskHeads>,
) -> Vec<Offsets> {
    let chains = heads.chains().chain(masks.iter().flat_map(|masks| masks.chains()));
    let chains: Vec<&[Linear]> = chains.map(|chain| &*chain.layers).collect();
    let mut widths = vec![3, 3, 4];
    widths.extend(heads.opacity_logits.as_ref().map(|_| 1));
    widths.extend(heads.sh.as_ref().map(|_| SH_OUTPUTS));
    widths.extend(masks.map(|_| MASK_OUTPUTS));
    let offsets = |parts: Vec<Tensor<2>>| {
        let mut parts = parts.into_iter();
        // Proof: there is a part for each width.
        let mut next = || parts.next().expect("a head has its columns");
        Offsets {
            means: next(),
            log_scales: next(),
            quaternions: next(),
            opacity_logits: heads.opacity_logits.as_ref().map(|_| next()),
            sh: heads.sh.as_ref().map(|_| next()),
            mask_logits: masks.map(|_| next()),
        }
    };
    apart(side_by_side(&chains, feature, Rectified::Yes), counts, &widths).into_iter().map(offsets).collect()
}

impl Offsets {
    /// All offsets concatenated, `[N, outputs]`: centres, log-scales, quaternions, opacity, colour, mask logits. Absent
    /// heads leave no gap.
    pub fn joined(self) -> Tensor<2> {
        let geometry = [self.means, self.log_scales, self.quaternions];
        Tensor::cat(geometry.into_iter().chain(self.opacity_logits).chain(self.sh).chain(self.mask_logits).collect(), 1)
    }
}

impl std::ops::Add for Offsets {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let both = |a: Option<Tensor<2>>, b: Option<Tensor<2>>| a.zip(b).map(|(a, b)| a + b);
        Self {
            means: self.means + other.means,
            log_scales: self.log_scales + other.log_scales,
            quaternions: self.quaternions + other.quaternions,
            opacity_logits: both(self.opacity_logits, other.opacity_logits),
            sh: both(self.sh, other.sh),
            mask_logits: both(self.mask_logits, other.mask_logits),
        }
    }
}
