//! The deformation network: the offsets of a dynamic Gaussian's attributes at a time.

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_render::grid::{GridBounds, GridLayout};
use mvfusion_render::profile::{Part, measure};

use super::heads::{HeadChoice, decode};
use super::{AttributeHeads, HexPlane, MaskHeads, Mlp, ModuleInit, Offsets};
use crate::config::{Branches, ModelConfig};

/// Size of a [`DeformationNetwork`].
#[derive(Clone, Debug, PartialEq)]
pub struct DeformationConfig {
    /// Layout of the HexPlane field.
    pub layout: GridLayout,
    /// The box of the field.
    pub bounds: GridBounds,
    /// Width `H` of trunk and heads.
    pub width: usize,
    /// Linear layers of the trunk; 0 and 1 both mean one.
    pub depth: usize,
    /// The optional heads.
    pub heads: HeadChoice,
}

/// HexPlane field, trunk and heads: `offsets = heads(trunk(field(x, t)))` (METHOD §2).
#[derive(Module, Debug)]
pub struct DeformationNetwork {
    /// The field.
    pub grid: HexPlane,
    /// Maps field features to the hidden feature `h`, without a final activation.
    pub trunk: Mlp,
    /// Heads of the attributes.
    pub heads: AttributeHeads,
    /// Heads of the masks.
    pub masks: Option<MaskHeads>,
}

impl DeformationConfig {
    /// The network of a run's model, with a field over `bounds`.
    pub fn of(model: &ModelConfig, bounds: GridBounds) -> Self {
        let heads =
            HeadChoice { opacity: model.deform_opacity, sh: model.deform_sh, masks: model.branches == Branches::Both };
        Self { layout: model.grid.layout(), bounds, width: model.width, depth: model.depth, heads }
    }

    /// A network with new weights.
    pub fn init(&self, init: &mut ModuleInit<'_>) -> DeformationNetwork {
        let grid = HexPlane::new(self.layout.clone(), self.bounds, init);
        let mut widths = vec![self.layout.feature_count()];
        widths.resize(1 + self.depth.max(1), self.width);
        DeformationNetwork {
            grid,
            trunk: init.mlp(&widths),
            heads: AttributeHeads::new(self.width, self.heads, init),
            masks: self.heads.masks.then(|| MaskHeads::new(self.width, init)),
        }
    }
}

impl DeformationNetwork {
    /// The hidden feature `h` `[N, width]` of canonical centres `[N, 3]` at times `[N, 1]` or `[1, 1]`.
    pub fn feature(&self, means: Tensor<2>, times: Tensor<2>) -> Tensor<2> {
        let features = measure(Part::LookUp, || self.grid.forward(means, times));
        measure(Part::Network, || self.trunk.forward(features))
    }

    /// The offsets of all attributes for a hidden feature `[N, width]`.
    pub fn decode(&self, feature: Tensor<2>) -> Offsets {
        measure(Part::Network, || decode(feature, &self.heads, self.masks.as_ref()))
    }
}
