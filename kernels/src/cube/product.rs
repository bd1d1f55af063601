//! Matrix products fused with the MLP's operations before and after them, so that a layer is one launch. CPU twin:
//! `mlp/cpu.rs`.
//!
//! A cube computes a tile of the result over a slab of the depth, a few columns of the depth at a time. A unit computes
//! a block of the tile.

use cubecl::prelude::*;

use super::maths::at_most_zero;
use super::stage::{FOUR, Four};

/// Bytes of shared memory that every device has.
const SHARED: usize = 16 << 10;

/// The position of a matrix in its buffer: row r, column c is at `first + row r + column c`.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct MatrixLayout {
    /// Index of the first element.
    pub first: u32,
    /// Distance from one row to the next.
    pub row: u32,
    /// Distance from one column to the next.
    pub column: u32,
}

/// The sizes of a product.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct ProductSize {
    /// Rows of the left matrix and of the result.
    pub rows: u32,
    /// Columns of the right matrix and of the result.
    pub columns: u32,
    /// Columns of the left matrix and rows of the right one.
    pub depth: u32,
    /// The part of the depth that one cube sums.
    pub slab: u32,
}

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
    /// The plan for a GPU. Sixteen neighbours of a row are read together, as much as memory delivers at once.
    pub const GPU: Self = Self { units: 64, block: [8, 8], stride: 16, least_slab: 256 };
    /// The plan for a GPU and at most eight columns, as the heads have: reading is all of the work, so many small cubes.
    pub const GPU_NARROW: Self = Self { units: 32, block: [4, 4], stride: 16, least_slab: 256 };
    /// The plan for a driver that computes on the CPU: larger blocks, because reading a number costs as much as a product.
    pub const SOFTWARE: Self = Self { units: 16, block: [16, 8], stride: 4, least_slab: 1024 };

    /// The plan for a GPU and a result of this many columns.
    pub const fn of_gpu(columns: usize) -> Self {
        if columns <= 2 * Self::GPU_NARROW.block[1] { Self::GPU_NARROW } else { Self::GPU }
    }
}

impl ProductKind {
    /// The kind for a result of this many columns. A tile has as many blocks across as down, or fewer for a narrow
    /// result.
    pub fn new(plan: ProductPlan, columns: usize, rectified: bool, end: End) -> Self {
        let [block_rows, block_columns] = plan.block;
        let across = columns.div_ceil(block_columns).next_power_of_two().min(plan.units.isqrt());
        let kind = Self { units: plan.units, block_rows, block_columns, across, stride: plan.stride, rectified, end };
        let strides = std::iter::successors(Some(kind), |kind| Some(Self { stride: kind.stride / 2, ..*kind }));
        // Proof: four columns of the largest tile fit.
        strides.take_while(|kind| kind.stride >= FOUR).find(|kind| kind.shared_bytes() <= SHARED).expect("a tile fits")
    }

    /// Bytes of shared memory.
    const fn shared_bytes(&self) -> usize {
        self.stride * (self.left_pitch() + self.right_pitch()) * FOUR * size_of::<f32>()
    }

    /// Vectors from one column of the depth to the next in shared memory. One is left out, so that units that write
    /// neighbouring columns use different banks.
    const fn left_pitch(&self) -> usize {
        self.tile_rows() / FOUR + 1
    }

    /// The same for the right matrix.
    const fn right_pitch(&self) -> usize {
        self.tile_columns() / FOUR + 1
    }

    /// Whether values of the left matrix that are neighbours in memory are neighbours in the depth.
    const fn left_along_depth(&self) -> bool {
        !matches!(self.end, End::Slabs)
    }

    /// The same for the right matrix.
    const fn right_along_depth(&self) -> bool {
        matches!(self.end, End::Adjoint { .. })
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
    const fn fours(&self) -> usize {
        self.block_columns / FOUR
    }
}

/// `result = end(left right)`.
///
/// Only a layer reads the bias, one value per column. `gate_layout` has the gate's position in its buffer. The slabs of
/// the result are `slab_stride` apart.
#[cube(launch_unchecked)]
pub fn product(
    left: &[f32],
    right: &[f32],
    bias: &[f32],
    gate: &[f32],
    result: &mut [f32],
    size: ProductSize,
    left_layout: MatrixLayout,
    right_layout: MatrixLayout,
    result_layout: MatrixLayout,
    gate_layout: MatrixLayout,
    slab_stride: u32,
    #[comptime] kind: ProductKind,
) {
    let (tile_rows, tile_columns) = comptime!((kind.tile_rows() as u32, kind.tile_columns() as u32));
    let (left_pitch, right_pitch) = comptime!((kind.left_pitch(), kind.right_pitch()));
    let (left_tasks, right_tasks) =
        comptime!((kind.stride * kind.tile_rows() / FOUR, kind.stride * kind.tile_columns() / FOUR));
    let fours = comptime!(kind.fours());
    let sums_right = comptime!(kind.end == End::Slabs);
    let mut lefts = Shared::<[Four]>::new_slice(comptime!(kind.stride * kind.left_pitch()));
    let mut rights = Shared::<[Four]>::new_slice(comptime!(kind.stride * kind.right_pitch()));

    let tiles_across = (size.columns + (tile_columns - 1u32)) / tile_columns;
    let tiles_down = (size.rows + (tile_rows - 1u32)) / tile_rows;
    let slabs = (size.depth + size.slab - 1u32) / size.slab;
    let cube = CUBE_POS as u32;
    if cube < tiles_across * tiles_down * slabs {
        let first_column = cube % tiles_across * tile_columns;
        let first_row = cube / tiles_across % tiles_down * tile_rows;
        let slab = cube / tiles_across / tiles_down;
        let slab_end = min((slab + 1u32) * size.slab, size.depth);
        let (across, down) = (UNIT_POS as usize % comptime!(kind.across), UNIT_POS as usize / comptime!(kind.across));

        let mut sums = Array::<Four>::new(comptime!(kind.block_rows * kind.fours()));
        #[unroll]
        for i in 0..comptime!(kind.block_rows * kind.fours()) {
            sums[i] = Four::new(0.0f32);
        }
        let mut right_sums = Array::<Four>::new(fours);
        #[unroll]
        for i in 0..fours {
            right_sums[i] = Four::new(0.0f32);
        }
        let mut depth = slab * size.slab;
        while depth < slab_end {
            #[unroll]
            for turn in 0..comptime!(left_tasks.div_ceil(kind.units)) {
                let task = UNIT_POS as usize + comptime!(turn * kind.units);
                if comptime!(left_tasks % kind.units == 0) || task < left_tasks {
                    let (step, four) = place_of(task, left_tasks, kind.stride, comptime!(kind.left_along_depth()));
                    let row = first_row + (four * FOUR) as u32;
                    lefts[step * left_pitch + four] =
                        left_four(left, &left_layout, row, depth + step as u32, slab_end, &size, kind);
                }
            }
            #[unroll]
            for turn in 0..comptime!(right_tasks.div_ceil(kind.units)) {
                let task = UNIT_POS as usize + comptime!(turn * kind.units);
                if comptime!(right_tasks % kind.units == 0) || task < right_tasks {
                    let (step, four) = place_of(task, right_tasks, kind.stride, comptime!(kind.right_along_depth()));
                    let column = first_column + (four * FOUR) as u32;
                    rights[step * right_pitch + four] =
                        right_four(right, &right_layout, depth + step as u32, column, slab_end, &size);
                }
            }
            sync_cube();
            for part in 0..comptime!(kind.stride / FOUR) {
                #[unroll]
                for in_part in 0..FOUR {
                    let step = part * FOUR + in_part;
                    let mut own = Array::<Four>::new(fours);
                    #[unroll]
                    for i in 0..fours {
                        own[i] = rights[step * right_pitch + across * fours + i];
                        if sums_right {
                            right_sums[i] += own[i];
                        }
                    }
                    #[unroll]
                    for quarter in 0..comptime!(kind.block_rows / FOUR) {
                        let rows = lefts[step * left_pitch + down * comptime!(kind.block_rows / FOUR) + quarter];
                        #[unroll]
                        for part in 0..FOUR {
                            let row = Four::new(rows.extract(part));
                            #[unroll]
                            for i in 0..fours {
                                sums[comptime!((FOUR * quarter + part) * kind.fours() + i)] += row * own[i];
                            }
                        }
                    }
                }
            }
            sync_cube();
            depth += comptime!(kind.stride as u32);
        }

        let slab_first = (slab * slab_stride) as usize;
        #[unroll]
        for j in 0..comptime!(kind.block_columns) {
            let column = first_column + (across * comptime!(kind.block_columns)) as u32 + comptime!(j as u32);
            if column < size.columns {
                #[unroll]
                for i in 0..comptime!(kind.block_rows) {
                    let row = first_row + (down * comptime!(kind.block_rows)) as u32 + comptime!(i as u32);
                    if row < size.rows {
                        let value = sums[comptime!(i * kind.fours() + j / FOUR)].extract(comptime!(j % FOUR));
                        let to = index_of(&result_layout, row, column) + slab_first;
                        result[to] = ended(value, bias, gate, result[to], row, column, &gate_layout, kind.end);
                    }
                }
                if sums_right && down == 0 && first_row == 0u32 {
                    let value = right_sums[comptime!(j / FOUR)].extract(comptime!(j % FOUR));
                    result[index_of(&result_layout, size.rows, column) + slab_first] = value;
                }
            }
        }
    }
}

/// The step of the depth and the four of a task of loading: neighbouring units read neighbouring memory.
#[cube]
fn place_of(
    task: usize,
    #[comptime] tasks: usize,
    #[comptime] stride: usize,
    #[comptime] along_depth: bool,
) -> (usize, usize) {
    let fours = comptime!(tasks / stride);
    if comptime!(along_depth) { (task % stride, task / stride) } else { (task / fours, task % fours) }
}

/// The value to write for the sum `value`, at a row and a column that contain `before`.
#[cube]
fn ended(
    value: f32,
    bias: &[f32],
    gate: &[f32],
    before: f32,
    row: u32,
    column: u32,
    gate_layout: &MatrixLayout,
    #[comptime] end: End,
) -> f32 {
    let mut value = value;
    if comptime!(matches!(end, End::Layer { .. })) {
        value += bias[column as usize];
    }
    if comptime!(matches!(end, End::Layer { rectified: true })) {
        value = rectified(value);
    }
    if comptime!(matches!(end, End::Adjoint { gated: true, .. })) {
        let closed = at_most_zero(gate[index_of(gate_layout, row, column)]);
        value = select(closed, 0.0f32, value);
    }
    if comptime!(matches!(end, End::Adjoint { added: true, .. })) {
        value += before;
    }
    value
}

/// The ReLU. NaN stays, so that it shows; `max` would turn it into zero.
#[cube]
fn rectified(value: f32) -> f32 {
    select(at_most_zero(value), 0.0f32, value)
}

#[cube]
fn index_of(layout: &MatrixLayout, row: u32, column: u32) -> usize {
    (layout.first + row * layout.row + column * layout.column) as usize
}

/// Four rows of a column of the left matrix; zeros beyond the matrix and beyond the slab.
#[cube]
fn left_four(
    left: &[f32],
    layout: &MatrixLayout,
    row: u32,
    column: u32,
    slab_end: u32,
    size: &ProductSize,
    #[comptime] kind: ProductKind,
) -> Four {
    let mut four = Four::new(0.0f32);
    #[unroll]
    for part in 0..FOUR {
        let row = row + comptime!(part as u32);
        let mut value = 0.0f32;
        if row < size.rows && column < slab_end {
            value = left[index_of(layout, row, column)];
        }
        if comptime!(kind.rectified) {
            value = rectified(value);
        }
        four.insert(part, value);
    }
    four
}

/// Four columns of a row of the right matrix; zeros beyond the matrix and beyond the slab.
#[cube]
fn right_four(right: &[f32], layout: &MatrixLayout, row: u32, column: u32, slab_end: u32, size: &ProductSize) -> Four {
    let mut four = Four::new(0.0f32);
    #[unroll]
    for part in 0..FOUR {
        let column = column + comptime!(part as u32);
        let mut value = 0.0f32;
        if row < slab_end && column < size.columns {
            value = right[index_of(layout, row, column)];
        }
        four.insert(part, value);
    }
    four
}
