//! Motion-aware refinement: MVG and MFTA added to the deformation feature, decoded by the unchanged heads
//! (paper, eq. of the refined deformation; METHOD §10.2).

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_render::profile::{Part, measure};

use super::moments::{MomentRows, joined, of_time};
use super::near::Near;
use super::token::TokenMaker;
use super::{DirectEncoder, Guidance, MotionEncoder, MotionModule, Substitutes, TemporalModule, Tokens};
use crate::config::{Descriptor, MotionConfig, Refinement, Temporal, TokenMode, TokenOffset, TokenValues};
use crate::model::network::{DeformationConfig, DeformationNetwork, ModuleInit, Offsets};
use crate::timeline::{Timeline, between};

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
    /// Half window, the unit of distances in time, in frames.
    pub window: usize,
    /// What tokens know of their distance from the current one.
    pub token_offset: TokenOffset,
    /// Octaves of its encoding.
    pub octaves: usize,
    /// What values are projected from.
    pub values: TokenValues,
    /// Gaussians per chunk of tokens.
    pub chunk: usize,
}

/// The inputs of a refined deformation, besides the two modules.
#[derive(Clone, Debug)]
pub struct RefinementConfig<'a> {
    /// The times of the training views.
    pub timeline: &'a Timeline,
    /// The moments whose Gaussians are deformed.
    pub moments: &'a [MomentRows<'a>],
    /// The scene's extent.
    pub extent: f64,
    /// What stands in for the modules' outputs. A substitute belongs to the Gaussians of a single moment.
    pub substitutes: &'a Substitutes,
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
            window: config.window,
            token_offset: config.token_offset,
            octaves: config.octaves,
            values: config.values,
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
        let width = network.width;
        let mut start = init.stream.clone();
        let paper = MotionConfig { descriptor: Descriptor::Variances, ..config.clone() };
        let encoder = MotionEncoder::new(width, &paper, init);
        let guidance = config.mvg.then(|| match config.descriptor {
            Descriptor::Variances | Descriptor::PositionVariance => Guidance::Encoder(encoder),
            Descriptor::Momentary => {
                Guidance::Encoder(MotionEncoder::new(width, config, &mut init.drawing_from(&mut start)))
            }
            Descriptor::Offsets => {
                let mut init = init.drawing_from(&mut start);
                Guidance::Direct(DirectEncoder::new(network.heads, width, config, &mut init))
            }
        });

        let mut start = init.stream.clone();
        let paper =
            MotionConfig { temporal: Temporal::Cross, token_offset: TokenOffset::Absent, residual: false, ..paper };
        let attention = TemporalModule::new(width, &paper, init);
        let temporal = config.mfta.then(|| match (config.temporal, config.token_offset, config.residual) {
            (Temporal::Cross, TokenOffset::Absent, false) => attention,
            _ => TemporalModule::new(width, config, &mut init.drawing_from(&mut start)),
        });
        Self { guidance, temporal, rules: RefinementRules::new(config) }
    }

    /// The refined offsets of canonical centres `[M, 3]`, which are those of the configured moments in turn.
    ///
    /// Gradients reach the network only through the feature. Neighbour tokens (unless `neighbour_gradient` is on), the
    /// geometry inside the centre token and all descriptors are constants (A17).
    pub fn offsets(&self, network: &DeformationNetwork, means: Tensor<2>, config: &RefinementConfig<'_>) -> Offsets {
        let (base, added) = self.features(network, means, config);
        let refined = network.decode(added.into_iter().flatten().fold(base.clone(), |sum, part| sum + part));
        let of_base = || network.decode(base);
        match (self.rules.refinement, self.rules.refine_masks) {
            (Refinement::Replace, true) => refined,
            (Refinement::Replace, false) => refined.with_masks_of(&of_base()),
            (Refinement::Sum, true) => of_base() + refined,
            (Refinement::Sum, false) => {
                let base = of_base();
                (base.clone() + refined).with_masks_of(&base)
            }
        }
    }

    /// The feature of the base deformation of canonical centres `[M, 3]`, and what MVG and MFTA add to it: `[M, H]` each.
    fn features(
        &self,
        network: &DeformationNetwork,
        means: Tensor<2>,
        config: &RefinementConfig<'_>,
    ) -> (Tensor<2>, [Option<Tensor<2>>; 2]) {
        let count = means.dims()[0];
        let base = self.base(network, &means, config);
        let mvg = self.guidance.as_ref().map(|guidance| {
            let own = || measure(Part::Mvg, || guidance.forward(network, &base, config.moments));
            config.substitutes.output(MotionModule::Mvg, count, own)
        });
        let mfta = self.temporal.as_ref().map(|temporal| {
            let tokens = || self.tokens(network, means, base.clone(), config);
            let own = || measure(Part::Mfta, || temporal.forward(tokens()));
            config.substitutes.output(MotionModule::Mfta, count, own)
        });
        (base, [mvg, mfta])
    }

    /// The feature of the base deformation of canonical centres `[M, 3]`: `[M, H]`.
    pub(super) fn base(
        &self,
        network: &DeformationNetwork,
        means: &Tensor<2>,
        config: &RefinementConfig<'_>,
    ) -> Tensor<2> {
        network.feature(means.clone(), of_time(config.moments, means, |time| vec![time]))
    }

    /// The tokens of canonical centres `[M, 3]` with the feature `[M, H]`, each at its moment and around it.
    pub(super) fn tokens(
        &self,
        network: &DeformationNetwork,
        means: Tensor<2>,
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
        let known = |local: Tensor<2>| match self.guidance {
            Some(_) => local,
            None => local.zeros_like(),
        };
        let RefinementConfig { timeline, moments, .. } = *config;
        let geometry = maker.geometry(feature.clone().inner());
        let local = joined(moments, |rows| known(rows.cache.local_at(rows.time)));
        let centre = Tensor::cat(vec![feature, geometry.clone(), local], 1);

        let RefinementRules { token_offset, octaves, .. } = self.rules;
        if let Some(TemporalModule::Spatial(_)) = &self.temporal {
            let near = Near::joined(&moments.iter().map(MomentRows::near).collect::<Vec<_>>());
            let place = |rows: &MomentRows<'_>| between(&rows.cache.knot_times, rows.time);
            let local = joined(moments, |rows| known(rows.near().local_at(place(rows))));
            let times = of_time(moments, &means, |time| vec![time]);
            let tokens = Tokens::new(centre, around.of_others(&near.means, &times, local));
            return tokens.at_distances(near.distances(means), token_offset, octaves);
        }
        let neighbours = |time: f64| -> Vec<f64> {
            let index = timeline.nearest(time);
            self.rules.frames.iter().map(|&frame| timeline.neighbour(index, frame)).collect()
        };
        let local = joined(moments, |rows| {
            let at_each = neighbours(rows.time).into_iter().map(|time| known(rows.cache.local_at(time)));
            Tensor::cat(at_each.collect(), 1)
        });
        let tokens = Tokens::new(centre, around.at(&means, &of_time(moments, &means, neighbours), local));

        let window = self.rules.window as f64 * timeline.spacing();
        let distances = of_time(moments, &means, |time| {
            neighbours(time).into_iter().map(|other| (other - time) / window).collect()
        });
        let distances = distances.unsqueeze_dim(2);
        let tokens = match self.rules.values {
            TokenValues::States => tokens,
            TokenValues::Velocities => tokens.with_velocities(geometry, distances.clone()),
        };
        tokens.at_distances(distances, token_offset, octaves)
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
