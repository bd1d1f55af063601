//! The tile lists: the Gaussians that touch each tile, nearest first. The frames of a batch are sorted together, because
//! a sort consists of many short launches. CPU twin: `splat/cpu/tiles.rs`.

use std::sync::Arc;

use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::tiles::{FramePlaceLaunch, emit_pairs, find_starts, list_pairs};

use super::frame::{Frame, ProjectedFrame};
use super::gpu::{CUBE, Flat};
use super::sort::{Keyed, bits_of, sort};
use crate::splat::SplatError;

/// Bytes per pair of a Gaussian and a tile in each list.
pub(super) const PAIR_BYTES: u64 = 4;

/// The tile lists; see [`SplatSaved`](crate::splat::op::SplatSaved).
pub(super) struct Bins {
    pub sorted: CubeTensor,
    pub starts: CubeTensor,
    pub slots: CubeTensor,
}

/// Frames that are sorted by tile together.
pub(super) struct Run<'a> {
    pub frames: &'a [Arc<ProjectedFrame>],
    /// The lengths of their lists, together below 2³¹.
    pub lengths: &'a [u32],
    /// See [`sort_by_depth`](super::depth::sort_by_depth).
    pub begins: &'a CubeTensor,
    /// Gaussians and pairs of the frames before these that were sorted by depth with them.
    pub gaussians_before: usize,
    pub pairs_before: usize,
}

/// A frame of a run.
struct Part<'a> {
    own: &'a ProjectedFrame,
    /// The length of its lists.
    pairs: usize,
    /// See [`FramePlace`](mvfusion_kernels::cube::tiles::FramePlace).
    gaussian: usize,
    before: usize,
    pair: usize,
    tile: usize,
}

impl Run<'_> {
    /// The tile lists of the frames.
    pub fn sort_by_tile(&self) -> Vec<Bins> {
        let gpu = &self.frames[0].frame.gpu;
        let total: usize = self.lengths.iter().map(|&length| length as usize).sum();
        if total == 0 {
            return self.frames.iter().map(|own| own.frame.no_bins()).collect();
        }
        let (mut gaussian, mut pair, mut tile) = (self.gaussians_before, 0, 0);
        let mut parts = Vec::new();
        for (own, &pairs) in self.frames.iter().zip(self.lengths) {
            let pairs = pairs as usize;
            parts.push(Part { own, pairs, gaussian, before: self.pairs_before, pair, tile });
            gaussian += own.frame.count();
            pair += pairs;
            // One more, for pairs that `emit_pairs` does not find again.
            tile += own.frame.view.tile_count() + 1;
        }
        let [tiles, owners] = [(); 2].map(|()| gpu.naturals(total));
        let slots: Vec<CubeTensor> = parts.iter().map(|part| part.emit(self.begins, &tiles, &owners)).collect();
        let by_tile = sort(gpu, tiles, None, &gpu.upload(&[total as u32]), total, bits_of(tile));
        parts.iter().zip(slots).map(|(part, slots)| part.list(&by_tile, &owners, slots)).collect()
    }
}

impl Part<'_> {
    fn place(&self) -> FramePlaceLaunch {
        FramePlaceLaunch::new(self.gaussian as u32, self.before as u32, self.pair as u32, self.tile as u32)
    }

    /// Writes the frame's pairs. Returns its slots, of which the positions are still missing.
    fn emit(&self, begins: &CubeTensor, tiles: &CubeTensor, owners: &CubeTensor) -> CubeTensor {
        let ProjectedFrame { frame, projected } = self.own;
        let gpu = &frame.gpu;
        let slots = gpu.integers([2 * frame.count() + self.pairs]);
        emit_pairs::launch(
            &gpu.client,
            gpu.units(frame.count()),
            CUBE,
            projected.records.clone().flat(),
            projected.radii.clone().flat(),
            projected.touched.clone().flat(),
            begins.clone().flat(),
            tiles.clone().flat(),
            owners.clone().flat(),
            slots.clone().flat(),
            frame.view(),
            self.place(),
            frame.count() as u32,
            frame.is_square(),
        );
        slots
    }

    /// The frame's lists.
    fn list(&self, by_tile: &Keyed, owners: &CubeTensor, slots: CubeTensor) -> Bins {
        let frame = &self.own.frame;
        let (gpu, tiles) = (&frame.gpu, frame.view.tile_count());
        let sorted = gpu.integers([self.pairs]);
        list_pairs::launch(
            &gpu.client,
            gpu.units(self.pairs),
            CUBE,
            owners.clone().flat(),
            by_tile.numbers.clone().flat(),
            sorted.clone().flat(),
            slots.clone().flat(),
            self.pair as u32,
            self.pairs as u32,
            2 * frame.count() as u32,
        );
        let starts = gpu.integers([tiles + 1]);
        find_starts::launch(
            &gpu.client,
            gpu.units(tiles + 1),
            CUBE,
            by_tile.keys.clone().flat(),
            starts.clone().flat(),
            self.place(),
            self.pairs as u32,
            tiles as u32,
        );
        Bins { sorted, starts, slots }
    }
}

impl Frame {
    /// The lists of an empty image.
    pub fn no_bins(&self) -> Bins {
        let gpu = &self.gpu;
        Bins {
            sorted: gpu.integers([0]),
            starts: gpu.zeros([self.view.tile_count() + 1]),
            slots: gpu.zeros([2 * self.count()]),
        }
    }

    /// Checks that the device can bind the lists of `pairs` pairs, and another buffer of `pair_bytes` per pair.
    pub fn check_lists(&self, pairs: u32, pair_bytes: u64) -> Result<(), SplatError> {
        let limit = self.gpu.buffer_limit();
        check_pairs(pairs, pair_bytes, limit)?;
        // Before the pairs, `slots` has two numbers for each Gaussian.
        check_pairs(pairs.saturating_add(2 * self.count() as u32), PAIR_BYTES, limit)
    }
}

/// Checks that an index can count `pairs`, and that `bytes` per pair fit into `limit`. Larger counts arrive as
/// `u32::MAX`.
fn check_pairs(pairs: u32, bytes: u64, limit: u64) -> Result<(), SplatError> {
    if pairs > i32::MAX as u32 {
        return Err(SplatError::Pairs(pairs));
    }
    let bytes = bytes * u64::from(pairs);
    if bytes > limit { Err(SplatError::Buffer { tensor: "tile lists", bytes, limit }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_refused_beyond_the_buffer_and_beyond_the_index() {
        assert_eq!(check_pairs(1000, 48, 48_000), Ok(()));
        let refused = SplatError::Buffer { tensor: "tile lists", bytes: 48_048, limit: 48_000 };
        assert_eq!(check_pairs(1001, 48, 48_000), Err(refused));
        assert_eq!(check_pairs(i32::MAX as u32, 4, u64::MAX), Ok(()));
        assert_eq!(check_pairs(u32::MAX, 4, u64::MAX), Err(SplatError::Pairs(u32::MAX)));
    }
}
