//! The deformed dynamic Gaussians of some moments.

use burn::tensor::Tensor;
use mvfusion_render::device::is_gpu;

use super::alive::AliveRows;
use super::gaussians::RawGaussians;
use super::motion::{MomentRows, MotionCache, RefinementConfig, RefinementProbe, Substitutes};
use super::network::Offsets;
use super::{DeformationLevel, Model, RenderContext};
use crate::tensors;

/// Maximum number of rows that go through the networks together, if one moment has no more. Beyond it, launches are long
/// enough by themselves. With the paper's widths, the largest tensor then has 128 MiB, which every GPU binds.
const MOST_ROWS_TOGETHER: usize = 1 << 16;

/// The dynamic Gaussians at a time: those that are alive, or all.
pub(super) type Rows<'a> = (Option<&'a AliveRows>, f64);

impl Model {
    /// All dynamic Gaussians at a time, with lifetimes and deformation. Refinement falls back to the base deformation
    /// until motion was measured.
    pub fn dynamic_at(&self, time: f64, level: DeformationLevel, context: &RenderContext) -> RawGaussians {
        self.rows_at((None, time), level, context)
    }

    /// The same for the rows that are alive.
    pub(crate) fn rows_at(&self, moment: Rows<'_>, level: DeformationLevel, context: &RenderContext) -> RawGaussians {
        // Proof: there are rows for each moment.
        self.rows_at_each(&[moment], level, context).pop().expect("one moment")
    }

    /// The same at several moments. On a GPU, they go through the networks together, up to [`MOST_ROWS_TOGETHER`].
    pub(super) fn rows_at_each(
        &self,
        moments: &[Rows<'_>],
        level: DeformationLevel,
        context: &RenderContext,
    ) -> Vec<RawGaussians> {
        let canonical = self.dynamic.canonical();
        let of_rows = |&(alive, time): &Rows<'_>| {
            let gaussians = self.dynamic.alive(canonical.clone(), time);
            match alive {
                Some(alive) => gaussians.select(alive.rows()),
                None => gaussians,
            }
        };
        if level == DeformationLevel::Still {
            return moments.iter().map(of_rows).collect();
        }
        // A substitute has the rows of one moment. On a CPU, where launches cost nothing, fewer rows at a time are faster.
        let is_joint = self.substitutes.is_empty() && is_gpu(&canonical.means.device().inner());
        let rows = moments.iter().map(|(alive, _)| self.count_of(*alive)).max().unwrap_or_default();
        let together = if is_joint { moments_together(rows) } else { 1 };
        let deformed = |moments: &[Rows<'_>]| {
            let sets = moments.iter().map(of_rows).collect();
            RawGaussians::deformed_each(sets, self.offsets(moments, level, context))
        };
        moments.chunks(together).flat_map(deformed).collect()
    }

    /// The offsets of some moments, one after the other, computed together.
    fn offsets(&self, moments: &[Rows<'_>], level: DeformationLevel, context: &RenderContext) -> Offsets {
        let means = self.means_of(moments);
        let refined = match level {
            DeformationLevel::Still | DeformationLevel::Base => None,
            DeformationLevel::Refined => {
                self.refine(moments, context, |config| self.refinement.offsets(&self.network, means.clone(), config))
            }
        };
        refined.unwrap_or_else(|| self.base_offsets(means, moments))
    }

    /// The offsets of the base deformation for the canonical centres of some moments.
    fn base_offsets(&self, means: Tensor<2>, moments: &[Rows<'_>]) -> Offsets {
        let times: Vec<(usize, Vec<f64>)> =
            moments.iter().map(|&(alive, time)| (self.count_of(alive), vec![time])).collect();
        let times = tensors::rows_of_parts(&times, &means);
        self.network.decode(self.network.feature(means, times))
    }

    /// The offsets of the centres of Gaussians that the model does not have yet: `[M, 3]`, for canonical centres `[M, 3]`.
    /// `moments` holds the number of rows of each time, in turn. The offsets are refined if there are descriptors of
    /// these Gaussians.
    pub(crate) fn offsets_of_further(
        &self,
        means: Tensor<2>,
        moments: &[(usize, f64)],
        descriptors: Option<&MotionCache>,
        context: &RenderContext,
    ) -> Tensor<2> {
        let Some(cache) = descriptors else {
            let times: Vec<(usize, Vec<f64>)> = moments.iter().map(|&(count, time)| (count, vec![time])).collect();
            let feature = self.network.feature(means.clone(), tensors::rows_of_parts(&times, &means));
            return self.network.heads.geometry(feature).narrow(1, 0, 3);
        };
        let mut first = 0;
        let caches = moments.iter().map(|&(count, _)| {
            let rows: Vec<usize> = (first..first + count).collect();
            first += count;
            cache.clone().select(&tensors::rows_like(&rows, &means))
        });
        let caches: Vec<MotionCache> = caches.collect();
        let moments: Vec<MomentRows<'_>> =
            caches.iter().zip(moments).map(|(cache, &(_, time))| MomentRows { time, cache }).collect();
        let RenderContext { timeline, extent, .. } = context;
        // A substitute has the rows of the model's own Gaussians.
        let substitutes = Substitutes::default();
        let config = RefinementConfig { timeline, moments: &moments, extent: *extent, substitutes: &substitutes };
        self.refinement.offsets(&self.network, means, &config).means()
    }

    /// What the motion-aware modules compute for the rows that are alive; `None` until motion was measured.
    pub(crate) fn probe(&self, moment: Rows<'_>, context: &RenderContext) -> Option<RefinementProbe> {
        let means = self.means_of(&[moment]);
        self.refine(&[moment], context, |config| self.refinement.probe(&self.network, means, config))
    }

    /// Number of rows that are alive, or of all.
    fn count_of(&self, alive: Option<&AliveRows>) -> usize {
        alive.map_or(self.dynamic.count(), |alive| alive.rows().dims()[0])
    }

    /// Canonical centres of the rows of some moments.
    fn means_of(&self, moments: &[Rows<'_>]) -> Tensor<2> {
        let means = self.dynamic.means.val();
        let of_rows = |&(alive, _): &Rows<'_>| match alive {
            Some(alive) => means.clone().select(0, alive.rows().clone()),
            None => means.clone(),
        };
        match moments {
            [one] => of_rows(one),
            _ => Tensor::cat(moments.iter().map(of_rows).collect(), 0),
        }
    }

    /// Evaluates the refinement of the rows of some moments; `None` until motion was measured.
    fn refine<T>(
        &self,
        moments: &[Rows<'_>],
        context: &RenderContext,
        evaluate: impl FnOnce(&RefinementConfig<'_>) -> T,
    ) -> Option<T> {
        let cache = self.motion.as_ref()?;
        let of_rows = |&(alive, _): &Rows<'_>| match alive {
            Some(alive) => cache.clone().select(alive.rows()),
            None => cache.clone(),
        };
        let caches: Vec<MotionCache> = moments.iter().map(of_rows).collect();
        let substitutes = match moments {
            [(Some(alive), _)] => self.substitutes.select(alive.rows()),
            _ => self.substitutes.clone(),
        };
        let moments: Vec<MomentRows<'_>> =
            caches.iter().zip(moments).map(|(cache, &(_, time))| MomentRows { time, cache }).collect();
        let RenderContext { timeline, extent, .. } = context;
        let config = RefinementConfig { timeline, moments: &moments, extent: *extent, substitutes: &substitutes };
        Some(evaluate(&config))
    }
}

/// Number of moments, of at most `rows` rows each, that go through the networks together on a GPU.
pub(crate) fn moments_together(rows: usize) -> usize {
    (MOST_ROWS_TOGETHER / rows.max(1)).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_share_a_launch_unless_their_rows_make_it_long() {
        assert_eq!([30_000, 32_768, 32_769, 360_000].map(moments_together), [2, 2, 1, 1]);
        assert_eq!(moments_together(0), MOST_ROWS_TOGETHER);
    }
}
