//! Compile-time parameters of [`product`](super::product): how it is divided among the units, and its last operation.

use super::matrix::MatrixShare;
use super::stage::FOUR;

/// Rows and columns of a large result, which has tiles for every multiprocessor of a GPU.
const LARGE: [usize; 2] = [16_384, 64];

/// How a product is divided among the units.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ProductPlan {
    /// Units of a cube: a power of two.
    pub units: usize,
    /// Rows and columns of the result that a unit computes: multiples of four.
    pub block: [usize; 2],
    /// Columns of the depth that a cube processes between barriers, a power of two from four: fewer where they would not
    /// fit into shared memory.
    pub stride: usize,
    /// Rows that a cube sums at least for the adjoint of a weight. More rows mean fewer partial sums, fewer rows mean
    /// more parallel cubes.
    pub least_slab: usize,
    /// Whether a unit loads its next numbers while it multiplies, in unrolled loops. A driver that computes on the CPU gains
    /// nothing from it, and takes half as long again to compile the kernel.
    pub reads_ahead: bool,
}

/// Compile-time parameters of a product.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ProductKind {
    /// Units of a cube.
    pub units: usize,
    /// Rows of a unit's block.
    pub block_rows: usize,
    /// Columns of a unit's block.
    pub block_columns: usize,
    /// Blocks of a tile along a row.
    pub across: usize,
    /// Columns of the depth that a cube processes between barriers.
    pub stride: usize,
    /// Whether a unit loads its next numbers while it multiplies, in unrolled loops.
    pub reads_ahead: bool,
    /// Whether negative values of the left matrix count as zero.
    pub rectified: bool,
    /// The operation on the result.
    pub end: End,
}

/// The operation on the result when it is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum End {
    /// The sums of all slabs are written one after another. Each has one more row with the sums of the right matrix's
    /// columns.
    Slabs,
    /// A bias is added to each column; then negative values may become zero.
    Layer {
        /// Whether negative values become zero.
        rectified: bool,
    },
    /// An adjoint, optionally zero where `gate` is not positive, and optionally added to the previous values.
    Adjoint {
        /// Whether the gate applies.
        gated: bool,
        /// Whether the result is added to the previous values.
        added: bool,
    },
}

impl ProductPlan {
    /// The plan for a GPU.
    pub const GPU: Self = Self { units: 64, block: [8, 8], stride: 8, least_slab: 256, reads_ahead: true };
    /// The plan for a GPU and a large result: larger tiles, so that memory is read less often.
    pub const GPU_LARGE: Self = Self { units: 256, block: [8, 8], stride: 16, least_slab: 256, reads_ahead: true };
    /// The plan for a GPU and at most eight columns, as the heads have: reading is all of the work, so many small cubes.
    pub const GPU_NARROW: Self = Self { units: 32, block: [4, 4], stride: 8, least_slab: 256, reads_ahead: true };
    /// The plan for a driver that computes on the CPU: larger blocks, because reading a number costs as much as a product.
    pub const SOFTWARE: Self = Self { units: 16, block: [16, 8], stride: 4, least_slab: 1024, reads_ahead: false };

    /// The plan for a GPU and a result of this many rows and columns.
    pub const fn of_gpu([rows, columns]: [usize; 2]) -> Self {
        if columns <= 2 * Self::GPU_NARROW.block[1] {
            Self::GPU_NARROW
        } else if rows >= LARGE[0] && columns >= LARGE[1] {
            Self::GPU_LARGE
        } else {
            Self::GPU
        }
    }
}

impl ProductKind {
    /// The kind for a result of this many columns, on a device with `memory` bytes of shared memory per cube. A tile has
    /// as many blocks across as down, or fewer for a narrow result.
    pub fn new(plan: ProductPlan, columns: usize, rectified: bool, end: End, memory: usize) -> Self {
        let [block_rows, block_columns] = plan.block;
        // The largest power of two in the root of the units, which are one themselves.
        let most = 1 << (plan.units.ilog2() / 2);
        let across = columns.div_ceil(block_columns).next_power_of_two().min(most);
        let ProductPlan { units, stride, reads_ahead, .. } = plan;
        let kind = Self { units, block_rows, block_columns, across, stride, reads_ahead, rectified, end };
        let strides = std::iter::successors(Some(kind), |kind| Some(Self { stride: kind.stride / 2, ..*kind }));
        // Proof: four columns of the largest tile fit into the 16 KiB that every device has.
        strides.take_while(|kind| kind.stride >= FOUR).find(|kind| kind.shared_bytes() <= memory).expect("a tile fits")
    }

    /// Bytes of shared memory.
    const fn shared_bytes(&self) -> usize {
        (self.left_share().vectors() + self.right_share().vectors()) * FOUR * size_of::<f32>()
    }

    /// How the left matrix is loaded.
    pub(super) const fn left_share(&self) -> MatrixShare {
        let along_depth = !matches!(self.end, End::Slabs);
        let Self { units, stride, rectified, .. } = *self;
        MatrixShare { units, first: 0, fours: self.tile_rows() / FOUR, stride, along_depth, rectified }
    }

    /// How the right matrix is loaded.
    pub(super) const fn right_share(&self) -> MatrixShare {
        let along_depth = matches!(self.end, End::Adjoint { .. });
        let Self { units, stride, .. } = *self;
        let first = self.left_share().tasks();
        MatrixShare { units, first, fours: self.tile_columns() / FOUR, stride, along_depth, rectified: false }
    }

    /// Blocks that a unit loads.
    pub(super) const fn turns(&self) -> usize {
        (self.left_share().tasks() + self.right_share().tasks()).div_ceil(self.units)
    }

    /// Rows of a tile.
    pub const fn tile_rows(&self) -> usize {
        self.block_rows * self.units / self.across
    }

    /// Columns of a tile.
    pub const fn tile_columns(&self) -> usize {
        self.block_columns * self.across
    }

    /// Vectors in a row of a block.
    pub(super) const fn fours(&self) -> usize {
        self.block_columns / FOUR
    }
}
