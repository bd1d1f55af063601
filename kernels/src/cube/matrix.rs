//! Matrices in memory, and the tiles of them that the units of a cube bring to shared memory.

use cubecl::prelude::*;

use super::maths::rectified;
use super::stage::{FOUR, Four};

/// The position of a matrix in its buffer: number n of line m is at `first + stride m + n`. A line is a row, or a column of
/// a transposed matrix.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct MatrixLayout {
    /// Index of the first number.
    pub first: u32,
    /// Distance from one line to the next.
    pub stride: u32,
}

/// How the units load a matrix: in blocks of four by four numbers. The left matrix's blocks come first, then the right
/// one's. Each unit takes one, or a few in turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct MatrixShare {
    /// Units of a cube.
    pub units: usize,
    /// Number of the matrix's first block.
    pub first: usize,
    /// Fours of the tile along the side that is not the depth.
    pub fours: usize,
    /// Columns of the depth.
    pub stride: usize,
    /// Whether a line of the matrix in memory runs along the depth.
    pub along_depth: bool,
    /// Whether negative numbers count as zero.
    pub rectified: bool,
}

impl MatrixShare {
    /// Vectors from one column of the depth to the next in shared memory: an odd number, so that units that write
    /// neighbouring columns use different banks.
    pub(super) const fn pitch(&self) -> usize {
        self.fours | 1
    }

    /// Vectors in shared memory.
    pub(super) const fn vectors(&self) -> usize {
        self.stride * self.pitch()
    }

    /// Fours of the depth.
    pub(super) const fn quarters(&self) -> usize {
        self.stride / FOUR
    }

    /// Blocks.
    pub(super) const fn tasks(&self) -> usize {
        self.fours * self.quarters()
    }
}

/// Number of the unit's block in a turn, among those of a matrix.
#[cube]
pub(super) fn task_of(#[comptime] turn: usize, #[comptime] share: MatrixShare) -> usize {
    // Wraps before the first block, and is then not used.
    UNIT_POS as usize + comptime!(turn * share.units) - comptime!(share.first)
}

/// Whether the unit's block in a turn is one of a matrix. It is known at compile time where all units agree.
#[cube]
pub(super) fn is_of(#[comptime] turn: usize, #[comptime] share: MatrixShare) -> bool {
    let (begin, end) = comptime!((turn * share.units, (turn + 1) * share.units));
    let (first, last) = comptime!((share.first, share.first + share.tasks()));
    if comptime!(end <= first || begin >= last) {
        false.runtime()
    } else if comptime!(first <= begin && end <= last) {
        true.runtime()
    } else {
        let task = UNIT_POS as usize + begin;
        task >= first && task < last
    }
}

/// Where a block is, in fours: along the side of the tile, and along the depth. Neighbouring units read neighbouring memory.
#[cube]
pub(super) fn block_of(task: usize, #[comptime] share: MatrixShare) -> (usize, usize) {
    let (fours, quarters) = comptime!((share.fours, share.quarters()));
    if comptime!(share.along_depth) { (task / quarters, task % quarters) } else { (task % fours, task / fours) }
}

/// Loads the unit's block of a turn. `side` and `depth` are first and end positions along the side of the tile and along
/// the depth; numbers from the ends on are zero. A vector runs along a line of the matrix.
#[cube]
pub(super) fn load<N: Size>(
    values: &[Vector<f32, N>],
    layout: &MatrixLayout,
    ahead: &mut Array<Four>,
    #[comptime] turn: usize,
    side: (u32, u32),
    depth: (u32, u32),
    #[comptime] share: MatrixShare,
) {
    let (four, quarter) = block_of(task_of(turn, share), share);
    let (at_side, at_depth) = (side.0 + (four * FOUR) as u32, depth.0 + (quarter * FOUR) as u32);
    #[unroll]
    for i in 0..FOUR {
        let i_u32 = comptime!(i as u32);
        let vector = if comptime!(share.along_depth) {
            four_at(values, layout, (at_side + i_u32, at_depth), (side.1, depth.1))
        } else {
            four_at(values, layout, (at_depth + i_u32, at_side), (depth.1, side.1))
        };
        ahead[comptime!(FOUR * turn + i)] = if comptime!(share.rectified) { all_rectified(vector) } else { vector };
    }
}

/// Four numbers of a line; zeros from the ends on.
#[cube]
fn four_at<N: Size>(values: &[Vector<f32, N>], layout: &MatrixLayout, place: (u32, u32), ends: (u32, u32)) -> Four {
    let mut four = Four::new(0.0f32);
    let at = layout.first + place.0 * layout.stride + place.1;
    let size = N::value().comptime();
    #[unroll]
    for vector in 0..comptime!(FOUR / size) {
        if place.0 < ends.0 && place.1 + comptime!((vector * size) as u32) < ends.1 {
            let read = values[at as usize / size + vector];
            #[unroll]
            for part in 0..size {
                four.insert(comptime!(vector * size + part), read.extract(part));
            }
        }
    }
    four
}

/// Moves the unit's block of a turn to shared memory, where a vector runs along the side of the tile.
#[cube]
pub(super) fn stage(
    ahead: &Array<Four>,
    staged: &mut Shared<[Four]>,
    #[comptime] turn: usize,
    #[comptime] share: MatrixShare,
) {
    let (four, quarter) = block_of(task_of(turn, share), share);
    #[unroll]
    for i in 0..FOUR {
        let mut vector = ahead[comptime!(FOUR * turn + i)];
        if comptime!(share.along_depth) {
            #[unroll]
            for part in 0..FOUR {
                vector.insert(part, ahead[comptime!(FOUR * turn + part)].extract(i));
            }
        }
        staged[(quarter * FOUR + i) * comptime!(share.pitch()) + four] = vector;
    }
}

/// The ReLU of four numbers.
#[cube]
fn all_rectified(four: Four) -> Four {
    let mut four = four;
    #[unroll]
    for part in 0..FOUR {
        four.insert(part, rectified(four.extract(part)));
    }
    four
}
