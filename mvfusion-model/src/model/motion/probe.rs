//! What the motion-aware modules compute, for the figures of a trained model.

use std::collections::BTreeMap;

use burn::tensor::Tensor;

use super::{MotionModule, MotionRefinement, RefinementConfig};
use crate::model::network::{DeformationNetwork, Mlp};

/// What the modules compute for `N` Gaussians at their times.
#[derive(Clone, Debug)]
pub struct RefinementProbe {
    /// The feature of the base deformation: `[N, H]`.
    pub base: Tensor<2>,
    /// What the modules that the model has add to it.
    pub modules: BTreeMap<MotionModule, ModuleProbe>,
    /// The mean entropy of MFTA's attention over Gaussians and heads, in nats: `[1]`; `None` without attention.
    pub entropy: Option<Tensor<1>>,
}

/// What a module computes.
#[derive(Clone, Debug)]
pub struct ModuleProbe {
    /// Its output: `[N, H]`.
    pub output: Tensor<2>,
    /// The last hidden units of its MLP before their activation: `[N, hidden]`.
    pub hidden: Tensor<2>,
}

impl ModuleProbe {
    /// Of a module that applies these layers to `[N, inputs]`.
    fn new(mlp: &Mlp, input: Tensor<2>) -> Self {
        Self { output: mlp.forward(input.clone()), hidden: mlp.hidden(input) }
    }
}

impl MotionRefinement {
    /// What the modules compute for canonical centres `[N, 3]`, which are those of the configured moments in turn.
    /// Nothing is substituted.
    pub fn probe(
        &self,
        network: &DeformationNetwork,
        means: Tensor<2>,
        config: &RefinementConfig<'_>,
    ) -> RefinementProbe {
        let base = self.base(network, &means, config);
        let mut modules = BTreeMap::new();
        if let Some(guidance) = &self.guidance {
            let input = guidance.input(network, &base, config.moments);
            modules.insert(MotionModule::Mvg, ModuleProbe::new(guidance.mlp(), input));
        }
        let mut entropy = None;
        if let Some(temporal) = &self.temporal {
            let tokens = self.tokens(network, means, base.clone(), config);
            entropy = temporal.entropy(tokens.clone());
            modules.insert(MotionModule::Mfta, ModuleProbe::new(temporal.mlp(), temporal.mix(tokens)));
        }
        RefinementProbe { base, modules, entropy }
    }
}
