//! Motion-aware refinement: MVG and MFTA added to the deformation feature, decoded by the unchanged heads
//! (paper, eq. of the refined deformation; METHOD §10.2).

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_render::profile::{Part, measure};

use super::token::Tokens;
use super::{MotionCache, MotionEncoder, TemporalAttention};
use crate::config::{MotionConfig, Refinement, TokenMode};
use crate::network::{DeformationNetwork, LayerInit, Offsets};
use crate::timeline::Timeline;

/// The two motion-aware branches.
#[derive(Module, Debug)]
pub struct MotionRefinement {
    /// MVG.
    pub encoder: MotionEncoder,
    /// MFTA.
    pub attention: TemporalAttention,
}

/// What a refined deformation needs beside the two branches.
#[derive(Clone, Debug)]
pub struct RefinementConfig<'a> {
    /// Switches and window.
    pub motion: &'a MotionConfig,
    /// The times of the training views.
    pub timeline: &'a Timeline,
    /// The cached descriptors.
    pub cache: &'a MotionCache,
    /// The scene's extent.
    pub extent: f64,
}

impl MotionRefinement {
    /// Fresh branches for features of `width`; both start without effect.
    pub fn new(width: usize, config: &MotionConfig, init: &mut LayerInit<'_>) -> Self {
        Self {
            encoder: MotionEncoder::new(width, config.hidden, config.octaves, init),
            attention: TemporalAttention::new(width, config.attention_width, config.hidden, config.heads, init),
        }
    }

    /// The refined offsets of canonical centres `[N, 3]` at a time.
    ///
    /// Gradients reach the network through the feature alone: neighbour tokens, the geometry inside the centre token and
    /// all descriptors are constants (A17).
    pub fn offsets(
        &self,
        network: &DeformationNetwork,
        means: Tensor<2>,
        time: f64,
        config: &RefinementConfig<'_>,
    ) -> Offsets {
        let feature = network.feature(means.clone(), crate::tensors::scalar_like(&means, time));
        let mut fused = feature.clone();
        if config.motion.mvg {
            fused = fused
                + measure(Part::Mvg, || {
                    self.encoder.forward(config.cache.signatures.clone(), config.cache.local_at(time))
                });
        }
        if config.motion.mfta {
            fused = fused + measure(Part::Mfta, || self.temporal(network, means, time, feature.clone(), config));
        }
        let refined = network.decode(fused);
        match (config.motion.refinement, config.motion.refine_masks) {
            (Refinement::Replace, true) => refined,
            (Refinement::Replace, false) => Offsets { mask_logits: network.decode(feature).mask_logits, ..refined },
            (Refinement::Sum, true) => network.decode(feature) + refined,
            (Refinement::Sum, false) => {
                let base = network.decode(feature);
                Offsets { mask_logits: base.mask_logits.clone(), ..base + refined }
            }
        }
    }

    /// `h_MFTA` of a feature `[N, H]`.
    fn temporal(
        &self,
        network: &DeformationNetwork,
        means: Tensor<2>,
        time: f64,
        feature: Tensor<2>,
        config: &RefinementConfig<'_>,
    ) -> Tensor<2> {
        let plain = network.valid();
        let tokens = Tokens { network: &plain, extent: config.extent, chunk: config.motion.chunk };
        let (around, means) = match config.motion.neighbour_gradient {
            true => (Tokens { network, ..tokens.clone() }, means),
            false => (tokens.clone(), means.inner()),
        };
        // Without MVG there are no motion statistics, so the tokens carry none either (A26).
        let local = |time: f64| match config.motion.mvg {
            true => config.cache.local_at(time),
            false => config.cache.local_at(time).zeros_like(),
        };
        let centre_tail = tokens.tail(feature.clone().inner(), local(time));
        let centre = Tensor::cat(vec![feature, centre_tail], 1);

        let index = config.timeline.nearest(time);
        let offsets = offsets(config.motion);
        let times: Vec<f64> = offsets.iter().map(|&offset| config.timeline.neighbour(index, offset)).collect();
        let local = Tensor::cat(times.iter().map(|&time| local(time)).collect(), 1);
        let neighbours = around.at(&means, &times, local);
        let neighbours = match config.motion.include_self {
            // Attention knows no order.
            true => Tensor::cat(vec![neighbours, centre.clone().unsqueeze_dim(1)], 1),
            false => neighbours,
        };
        self.attention.forward(centre, neighbours)
    }
}

/// Other frames that are attended to, relative to the current one, in time order (A7).
fn offsets(config: &MotionConfig) -> Vec<isize> {
    let window = config.window as isize;
    match config.tokens {
        TokenMode::Triple => vec![-window, window],
        TokenMode::FullWindow => (-window..=window).filter(|&offset| offset != 0).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_neighbours_are_attended_to_by_default() {
        assert_eq!(offsets(&MotionConfig::default()), [-5, 5]);
    }

    #[test]
    fn the_full_window_leaves_out_the_current_frame() {
        let config = MotionConfig { tokens: TokenMode::FullWindow, window: 2, ..MotionConfig::default() };
        assert_eq!(offsets(&config), [-2, -1, 1, 2]);
    }
}
