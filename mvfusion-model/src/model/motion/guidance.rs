//! The variants of MVG in the paper's tables.

use burn::module::Module;
use burn::tensor::Tensor;

use super::moments::{MomentRows, joined};
use super::{DirectEncoder, MotionEncoder};
use crate::model::network::{DeformationNetwork, Mlp};

/// A variant of MVG, which computes `h_MVG`. Names in checkpoints: `refinement.encoder`, `refinement.direct`.
#[derive(Module, Debug)]
pub enum Guidance {
    /// From trajectory statistics, as stored in the cache: complete, only of the position (A27), or with velocities.
    Encoder(MotionEncoder),
    /// From the raw offsets (A29).
    Direct(DirectEncoder),
}

impl Guidance {
    /// `h_MVG` of the rows of some moments, for their feature `[N, H]`. The inputs of the modules have no gradient (A17).
    pub fn forward(&self, network: &DeformationNetwork, feature: &Tensor<2>, moments: &[MomentRows<'_>]) -> Tensor<2> {
        self.mlp().forward(self.input(network, feature, moments))
    }

    /// The input of the layers: `[N, columns]`.
    pub(super) fn input(
        &self,
        network: &DeformationNetwork,
        feature: &Tensor<2>,
        moments: &[MomentRows<'_>],
    ) -> Tensor<2> {
        match self {
            Self::Encoder(encoder) => {
                let signatures = joined(moments, |rows| rows.cache.encoded(|signatures| encoder.encode(signatures)));
                encoder.join(signatures, joined(moments, |rows| rows.cache.moment_at(rows.time)))
            }
            Self::Direct(_) => network.valid().decode(feature.clone().inner()).joined(),
        }
    }

    /// The layers.
    pub fn mlp(&self) -> &Mlp {
        match self {
            Self::Encoder(encoder) => &encoder.mlp,
            Self::Direct(encoder) => &encoder.mlp,
        }
    }
}
