//! The tile lists: the Gaussians that touch each tile, nearest first. CPU twin: `splat/cpu/tiles.rs`.

use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::tiles::{
    collect_visible, counts_by_depth, emit_pairs, find_starts, list_pairs, mark_visible,
};

use super::frame::{Frame, Projected};
use super::gpu::{CUBE, Flat};
use super::scan::{RunningSums, running_sums};
use super::sort::{Keyed, sort};
use crate::splat::SplatError;

/// Bits of a depth's sort key.
const DEPTH_BITS: usize = 32;

/// Bytes per pair of a Gaussian and a tile in each list.
pub(super) const PAIR_BYTES: u64 = 4;

/// The tile lists; see [`SplatSaved`](crate::splat::op::SplatSaved).
pub(super) struct Bins {
    pub sorted: CubeTensor,
    pub starts: CubeTensor,
    pub slots: CubeTensor,
}

/// The visible Gaussians by depth.
struct ByDepth {
    /// Their indices, `[N]`; the first `visible` entries are valid.
    ids: CubeTensor,
    /// Number of visible Gaussians, `[1]`.
    visible: CubeTensor,
    /// Prefix sums of the number of tiles that they touch.
    pairs: RunningSums,
}

impl Frame {
    /// Lists the Gaussians of each tile by depth. `pairs` waits for the length of the lists. This is the only place where
    /// the host waits for the device.
    ///
    /// # Errors
    /// If a buffer of `pair_bytes` per list entry is too large for the device, the number of entries overflows an index,
    /// or the device fails.
    pub fn bin(
        &self,
        projected: &Projected,
        pairs: impl FnOnce() -> Result<u32, SplatError>,
        pair_bytes: u64,
    ) -> Result<Bins, SplatError> {
        let by_depth = self.sort_by_depth(projected);
        match pairs()? {
            0 => Ok(self.no_bins()),
            pairs => {
                check_pairs(pairs, pair_bytes, self.gpu.buffer_limit())?;
                // Before the pairs, `slots` has two numbers for each Gaussian.
                check_pairs(pairs.saturating_add(2 * self.count() as u32), PAIR_BYTES, self.gpu.buffer_limit())?;
                Ok(self.sort_by_tile(projected, by_depth, pairs as usize))
            }
        }
    }

    fn sort_by_depth(&self, projected: &Projected) -> ByDepth {
        let (gpu, count) = (&self.gpu, self.count());
        let marks = gpu.naturals(count);
        mark_visible::launch(
            &gpu.client,
            gpu.units(count),
            CUBE,
            projected.touched.clone().flat(),
            marks.clone().flat(),
            count as u32,
        );
        let ranks = running_sums(gpu, &marks, count);
        let visible = ranks.total;
        let by_index = Keyed { keys: gpu.naturals(count), numbers: gpu.naturals(count) };
        collect_visible::launch(
            &gpu.client,
            gpu.units(count),
            CUBE,
            projected.records.clone().flat(),
            projected.touched.clone().flat(),
            ranks.before.flat(),
            by_index.keys.clone().flat(),
            by_index.numbers.clone().flat(),
            count as u32,
        );
        let ids = sort(gpu, by_index, &visible, count, DEPTH_BITS).numbers;
        let counts = marks;
        counts_by_depth::launch(
            &gpu.client,
            gpu.units(count),
            CUBE,
            ids.clone().flat(),
            projected.touched.clone().flat(),
            visible.clone().flat(),
            counts.clone().flat(),
            count as u32,
        );
        ByDepth { ids, visible, pairs: running_sums(gpu, &counts, count) }
    }

    fn sort_by_tile(&self, projected: &Projected, by_depth: ByDepth, pairs: usize) -> Bins {
        let (gpu, count, tiles) = (&self.gpu, self.count(), self.view.tile_count());
        let unsorted = Keyed { keys: gpu.naturals(pairs), numbers: gpu.naturals(pairs) };
        let owners = gpu.naturals(pairs);
        let head = 2 * count;
        let slots = gpu.zeros([head + pairs]);
        emit_pairs::launch(
            &gpu.client,
            gpu.units(count),
            CUBE,
            projected.records.clone().flat(),
            projected.radii.clone().flat(),
            by_depth.ids.flat(),
            projected.touched.clone().flat(),
            by_depth.pairs.before.flat(),
            by_depth.visible.flat(),
            unsorted.keys.clone().flat(),
            owners.clone().flat(),
            unsorted.numbers.clone().flat(),
            slots.clone().flat(),
            self.view(),
            self.is_square(),
        );
        let by_tile = sort(gpu, unsorted, &by_depth.pairs.total, pairs, bits_of(tiles + 1));
        let sorted = gpu.integers([pairs]);
        list_pairs::launch(
            &gpu.client,
            gpu.units(pairs),
            CUBE,
            owners.flat(),
            by_tile.numbers.flat(),
            sorted.clone().flat(),
            slots.clone().flat(),
            pairs as u32,
            head as u32,
        );
        let starts = gpu.integers([tiles + 1]);
        find_starts::launch(
            &gpu.client,
            gpu.units(tiles + 1),
            CUBE,
            by_tile.keys.flat(),
            starts.clone().flat(),
            pairs as u32,
            tiles as u32,
        );
        Bins { sorted, starts, slots }
    }

    /// The lists of an empty image.
    pub fn no_bins(&self) -> Bins {
        let gpu = &self.gpu;
        Bins {
            sorted: gpu.integers([0]),
            starts: gpu.zeros([self.view.tile_count() + 1]),
            slots: gpu.zeros([2 * self.count()]),
        }
    }
}

/// Bits needed for the numbers below `count`.
fn bits_of(count: usize) -> usize {
    (usize::BITS - (count - 1).leading_zeros()) as usize
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
