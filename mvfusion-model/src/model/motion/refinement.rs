//! Motion-aware refinement: MVG and MFTA added to the deformation feature, decoded by the unchanged heads
//! (paper, eq. of the refined deformation; METHOD §10.2).

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_render::profile::{Part, measure};

use super::token::TokenMaker;
use super::{DirectEncoder, Guidance, MotionCache, MotionEncoder, TemporalModule, Tokens};
use crate::config::{Descriptor, MotionConfig, Refinement, Temporal, TokenMode};
use crate::model::network::{DeformationConfig, DeformationNetwork, ModuleInit, Offsets};
use crate::timeline::Timeline;

/// The motion-aware modules that the configuration selects.
#[derive(Module, Debug)]
pub struct MotionRefinement {
    /// MVG.
    pub guidance: Option<Guidance>,
    /// MFTA.
    pub temporal: Option<TemporalModule>,
    /// How the modules are applied.
    #[module(skip)]
    pub rules: RefinementRules,
}

/// How the two modules change the deformation: the switches of the configuration, resolved once.
#[derive(Clone, Debug)]
pub struct RefinementRules {
    /// Whether the refined offsets replace the base offsets or are added to them.
    pub refinement: Refinement,
    /// Whether the mask logits are also refined.
    pub refine_masks: bool,
    /// Whether gradients also reach the network through the tokens of neighbouring frames.
    pub neighbour_gradient: bool,
    /// The frames that MFTA uses, relative to the current one, in time order (A7).
    pub frames: Vec<isize>,
    /// Gaussians per chunk of tokens.
    pub chunk: usize,
}

/// The inputs of a refined deformation, besides the two modules.
#[derive(Clone, Debug)]
pub struct RefinementConfig<'a> {
    /// The times of the training views.
    pub timeline: &'a Timeline,
    /// The cached descriptors.
    pub cache: &'a MotionCache,
    /// The scene's extent.
    pub extent: f64,
}

impl RefinementRules {
    /// The rules of a configuration.
    pub fn new(config: &MotionConfig) -> Self {
        let window = config.window as isize;
        let frames = match config.tokens {
            TokenMode::Triple => vec![-window, window],
            TokenMode::FullWindow => (-window..=window).filter(|&frame| frame != 0).collect(),
        };
        Self {
            refinement: config.refinement,
            refine_masks: config.refine_masks,
            neighbour_gradient: config.neighbour_gradient,
            frames,
            chunk: config.chunk,
        }
    }
}

impl MotionRefinement {
    /// New modules for the features of a network, as configured; both start without effect.
    ///
    /// The stream always advances past the paper's own two modules. A variant is drawn from the position where the
    /// paper's module starts. Runs that differ in one module therefore start with the same weights in the other.
    pub fn new(network: &DeformationConfig, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        let (width, hidden) = (network.width, config.hidden);
        let mut start = init.stream.clone();
        let encoder = MotionEncoder::new(width, hidden, config.octaves, init);
        let guidance = config.mvg.then(|| match config.descriptor {
            Descriptor::Variances | Descriptor::PositionVariance => Guidance::Encoder(encoder),
            Descriptor::Offsets => {
                let mut init = init.drawing_from(&mut start);
                Guidance::Direct(DirectEncoder::new(network.heads, width, hidden, &mut init))
            }
        });

        let mut start = init.stream.clone();
        let cross = MotionConfig { temporal: Temporal::Cross, ..config.clone() };
        let attention = TemporalModule::new(width, &cross, init);
        let temporal = config.mfta.then(|| match config.temporal {
            Temporal::Cross => attention,
            _ => TemporalModule::new(width, config, &mut init.drawing_from(&mut start)),
        });
        Self { guidance, temporal, rules: RefinementRules::new(config) }
    }

    /// The refined offsets of canonical centres `[N, 3]` at a time.
    ///
    /// Gradients reach the network only through the feature. Neighbour tokens (unless `neighbour_gradient` is on), the
    /// geometry inside the centre token and all descriptors are constants (A17).
    pub fn offsets(
        &self,
        network: &DeformationNetwork,
        means: Tensor<2>,
        time: f64,
        config: &RefinementConfig<'_>,
    ) -> Offsets {
        let feature = network.feature(means.clone(), crate::tensors::scalar_like(&means, time));
        let mut fused = feature.clone();
        if let Some(guidance) = &self.guidance {
            fused = fused + measure(Part::Mvg, || guidance.forward(network, &feature, time, config.cache));
        }
        if let Some(temporal) = &self.temporal {
            let mixed = || temporal.forward(self.tokens(network, means, time, feature.clone(), config));
            fused = fused + measure(Part::Mfta, mixed);
        }
        let refined = network.decode(fused);
        match (self.rules.refinement, self.rules.refine_masks) {
            (Refinement::Replace, true) => refined,
            (Refinement::Replace, false) => Offsets { mask_logits: network.decode(feature).mask_logits, ..refined },
            (Refinement::Sum, true) => network.decode(feature) + refined,
            (Refinement::Sum, false) => {
                let base = network.decode(feature);
                Offsets { mask_logits: base.mask_logits.clone(), ..base + refined }
            }
        }
    }

    /// The tokens of canonical centres `[N, 3]` with the feature `[N, H]`, at a time and at the frames around it.
    fn tokens(
        &self,
        network: &DeformationNetwork,
        means: Tensor<2>,
        time: f64,
        feature: Tensor<2>,
        config: &RefinementConfig<'_>,
    ) -> Tokens {
        let plain = network.valid();
        let maker = TokenMaker { network: &plain, extent: config.extent, chunk: self.rules.chunk };
        let (around, means) = match self.rules.neighbour_gradient {
            true => (TokenMaker { network, ..maker.clone() }, means),
            false => (maker.clone(), means.inner()),
        };
        // Without MVG there are no motion statistics, so the tokens contain none (A26).
        let local = |time: f64| match self.guidance {
            Some(_) => config.cache.local_at(time),
            None => config.cache.local_at(time).zeros_like(),
        };
        let geometry = maker.geometry(feature.clone().inner());
        let centre = Tensor::cat(vec![feature, geometry, local(time)], 1);

        let index = config.timeline.nearest(time);
        let frames = self.rules.frames.iter();
        let times: Vec<f64> = frames.map(|&frame| config.timeline.neighbour(index, frame)).collect();
        let local = Tensor::cat(times.iter().map(|&time| local(time)).collect(), 1);
        Tokens { centre, around: around.at(&means, &times, local) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_neighbours_are_attended_to_by_default() {
        assert_eq!(RefinementRules::new(&MotionConfig::default()).frames, [-5, 5]);
    }

    #[test]
    fn the_full_window_leaves_out_the_current_frame() {
        let config = MotionConfig { tokens: TokenMode::FullWindow, window: 2, ..MotionConfig::default() };
        assert_eq!(RefinementRules::new(&config).frames, [-2, -1, 1, 2]);
    }
}
