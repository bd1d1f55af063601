//! MVG in the variants that the paper's tables compare.

use burn::module::Module;
use burn::tensor::Tensor;

use super::{DirectEncoder, MotionCache, MotionEncoder};
use crate::model::network::{DeformationNetwork, Mlp};

/// What makes `h_MVG`. Variants go by their names in checkpoints: `refinement.encoder`, `refinement.direct`.
#[derive(Module, Debug)]
pub enum Guidance {
    /// Of trajectory statistics, whole or of the position alone (A27): which of them it is lies in the cache.
    Encoder(MotionEncoder),
    /// Of the raw offsets (A29).
    Direct(DirectEncoder),
}

impl Guidance {
    /// `h_MVG` at a time, where the feature is `[N, H]`. What the modules are shown carries no gradient (A17).
    pub fn forward(
        &self,
        network: &DeformationNetwork,
        feature: &Tensor<2>,
        time: f64,
        cache: &MotionCache,
    ) -> Tensor<2> {
        match self {
            Self::Encoder(encoder) => encoder.forward(cache.signatures.clone(), cache.local_at(time)),
            Self::Direct(encoder) => encoder.forward(network.valid().decode(feature.clone().inner())),
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
