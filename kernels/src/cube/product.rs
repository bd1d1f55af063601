//! Matrix products fused with the MLP's operations before and after them, so that a layer is one launch. CPU twin:
//! `mlp/cpu.rs`.
//!
//! A cube computes a tile of the result over a slab of the depth, a few columns of the depth at a time. A unit computes
//! a block of the tile. On a GPU, the next columns are meanwhile on their way from memory to its registers.

use cubecl::prelude::*;

use super::maths::{at_most_zero, rectified};
use super::matrix::{MatrixLayout, block_of, is_of, load, stage, task_of};
use super::product_kind::{End, ProductKind};
use super::stage::{FOUR, Four};

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

/// `result = end(left right)`.
///
/// Buffers are read and written `L`, `R` and `O` numbers at a time: one, or four where all distances are multiples of four.
/// Only a layer reads the bias, one number per column. `gate_layout` has the gate's position in its buffer. The slabs of
/// the result are `slab_stride` apart.
#[cube(launch_unchecked)]
pub fn product<L: Size, R: Size, O: Size>(
    left: &[Vector<f32, L>],
    right: &[Vector<f32, R>],
    bias: &[Vector<f32, O>],
    gate: &[Vector<f32, O>],
    result: &mut [Vector<f32, O>],
    size: ProductSize,
    left_layout: MatrixLayout,
    right_layout: MatrixLayout,
    result_layout: MatrixLayout,
    gate_layout: MatrixLayout,
    slab_stride: u32,
    #[comptime] kind: ProductKind,
) {
    let (tile_rows, tile_columns) = comptime!((kind.tile_rows() as u32, kind.tile_columns() as u32));
    let turns = comptime!(kind.turns());
    let mut lefts = Shared::<[Four]>::new_slice(comptime!(kind.left_share().vectors()));
    let mut rights = Shared::<[Four]>::new_slice(comptime!(kind.right_share().vectors()));

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
        // Sums over the depth of each right block's columns.
        let mut right_sums = Array::<Four>::new(turns);
        #[unroll]
        for turn in 0..turns {
            right_sums[turn] = Four::new(0.0f32);
        }
        let mut ahead = Array::<Four>::new(comptime!(FOUR * kind.turns()));
        let mut depth = slab * size.slab;
        let sides = ((first_row, size.rows), (first_column, size.columns));
        if comptime!(kind.reads_ahead) {
            load_blocks(left, &left_layout, right, &right_layout, &mut ahead, sides, (depth, slab_end), kind);
        }
        while depth < slab_end {
            if comptime!(!kind.reads_ahead) {
                load_blocks(left, &left_layout, right, &right_layout, &mut ahead, sides, (depth, slab_end), kind);
            }
            depth += comptime!(kind.stride as u32);
            stage_blocks(&ahead, &mut lefts, &mut rights, &mut right_sums, kind);
            sync_cube();
            if comptime!(kind.reads_ahead) {
                load_blocks(left, &left_layout, right, &right_layout, &mut ahead, sides, (depth, slab_end), kind);
            }
            add_products(&lefts, &rights, &mut sums, (across, down), kind);
            sync_cube();
        }

        let to = MatrixLayout { first: result_layout.first + slab * slab_stride, stride: result_layout.stride };
        write_block(
            &sums,
            bias,
            gate,
            result,
            &to,
            &gate_layout,
            (first_row, first_column),
            (across, down),
            &size,
            kind,
        );
        if comptime!(kind.end == End::Slabs) {
            let column_sums = sum_over_quarters(&right_sums, &mut rights, kind);
            let four = UNIT_POS as usize;
            if four < comptime!(kind.right_share().fours) && first_row == 0u32 {
                let column = first_column + (four * FOUR) as u32;
                let to = to.first + size.rows * to.stride + column;
                write_ended(column_sums, bias, gate, result, to, to, column, size.columns, End::Slabs);
            }
        }
    }
}

/// Loads the unit's next block of each turn. `sides` are first and end positions of the tile in the left and in the right
/// matrix, and `depth` are those along the depth.
#[cube]
fn load_blocks<L: Size, R: Size>(
    left: &[Vector<f32, L>],
    left_layout: &MatrixLayout,
    right: &[Vector<f32, R>],
    right_layout: &MatrixLayout,
    ahead: &mut Array<Four>,
    sides: ((u32, u32), (u32, u32)),
    depth: (u32, u32),
    #[comptime] kind: ProductKind,
) {
    let (left_share, right_share) = comptime!((kind.left_share(), kind.right_share()));
    #[unroll]
    for turn in 0..comptime!(kind.turns()) {
        if is_of(turn, left_share) {
            load(left, left_layout, ahead, turn, sides.0, depth, left_share);
        } else if is_of(turn, right_share) {
            load(right, right_layout, ahead, turn, sides.1, depth, right_share);
        }
    }
}

/// Moves the unit's blocks to shared memory. Adds those of the right matrix to `right_sums`, where the slabs need them.
#[cube]
fn stage_blocks(
    ahead: &Array<Four>,
    lefts: &mut Shared<[Four]>,
    rights: &mut Shared<[Four]>,
    right_sums: &mut Array<Four>,
    #[comptime] kind: ProductKind,
) {
    let (left_share, right_share) = comptime!((kind.left_share(), kind.right_share()));
    #[unroll]
    for turn in 0..comptime!(kind.turns()) {
        if is_of(turn, left_share) {
            stage(ahead, lefts, turn, left_share);
        } else if is_of(turn, right_share) {
            stage(ahead, rights, turn, right_share);
            if comptime!(kind.end == End::Slabs) {
                #[unroll]
                for i in 0..FOUR {
                    right_sums[turn] += ahead[comptime!(FOUR * turn + i)];
                }
            }
        }
    }
}

/// Adds what the staged columns of the depth give to the unit's block of the result, whose `place` counts blocks across
/// and down.
#[cube]
fn add_products(
    lefts: &Shared<[Four]>,
    rights: &Shared<[Four]>,
    sums: &mut Array<Four>,
    place: (usize, usize),
    #[comptime] kind: ProductKind,
) {
    let (left_pitch, right_pitch) = comptime!((kind.left_share().pitch(), kind.right_share().pitch()));
    let (fours, quarters) = comptime!((kind.fours(), kind.block_rows / FOUR));
    for part in 0..comptime!(kind.stride / FOUR) {
        #[unroll(kind.reads_ahead)]
        for in_part in 0..FOUR {
            let step = part * FOUR + in_part;
            let mut own = Array::<Four>::new(fours);
            #[unroll]
            for i in 0..fours {
                own[i] = rights[step * right_pitch + comptime!(i * kind.across) + place.0];
            }
            #[unroll]
            for quarter in 0..quarters {
                let rows = lefts[step * left_pitch + place.1 * quarters + quarter];
                #[unroll]
                for part in 0..FOUR {
                    let row = Four::new(rows.extract(part));
                    #[unroll]
                    for i in 0..fours {
                        sums[comptime!((FOUR * quarter + part) * fours + i)] += row * own[i];
                    }
                }
            }
        }
    }
}

/// Writes the unit's block of the tile whose first row and column are `first`. `place` counts blocks across and down.
#[cube]
fn write_block<O: Size>(
    sums: &Array<Four>,
    bias: &[Vector<f32, O>],
    gate: &[Vector<f32, O>],
    result: &mut [Vector<f32, O>],
    result_layout: &MatrixLayout,
    gate_layout: &MatrixLayout,
    first: (u32, u32),
    place: (usize, usize),
    size: &ProductSize,
    #[comptime] kind: ProductKind,
) {
    #[unroll]
    for j in 0..comptime!(kind.block_rows) {
        let row = first.0 + (place.1 * comptime!(kind.block_rows)) as u32 + comptime!(j as u32);
        if row < size.rows {
            #[unroll]
            for i in 0..comptime!(kind.fours()) {
                let column = first.1 + ((comptime!(i * kind.across) + place.0) * FOUR) as u32;
                let sum = sums[comptime!(j * kind.fours() + i)];
                let to = result_layout.first + row * result_layout.stride + column;
                let at = gate_layout.first + row * gate_layout.stride + column;
                write_ended(sum, bias, gate, result, to, at, column, size.columns, kind.end);
            }
        }
    }
}

/// The sums of the right matrix's columns over the slab, in the first units. Shared memory is used again for them.
#[cube]
fn sum_over_quarters(right_sums: &Array<Four>, scratch: &mut Shared<[Four]>, #[comptime] kind: ProductKind) -> Four {
    let (left_share, right_share) = comptime!((kind.left_share(), kind.right_share()));
    let pitch = comptime!(right_share.pitch());
    #[unroll]
    for turn in 0..comptime!(kind.turns()) {
        if !is_of(turn, left_share) && is_of(turn, right_share) {
            let (four, quarter) = block_of(task_of(turn, right_share), right_share);
            scratch[quarter * pitch + four] = right_sums[turn];
        }
    }
    sync_cube();
    let mut sum = Four::new(0.0f32);
    if UNIT_POS < comptime!(right_share.fours as u32) {
        #[unroll]
        for quarter in 0..comptime!(right_share.quarters()) {
            sum += scratch[quarter * pitch + UNIT_POS as usize];
        }
    }
    sum
}

/// Writes four columns of a row of the result to `to`, as far as there are columns. The gate's are at `at`.
#[cube]
fn write_ended<O: Size>(
    sum: Four,
    bias: &[Vector<f32, O>],
    gate: &[Vector<f32, O>],
    result: &mut [Vector<f32, O>],
    to: u32,
    at: u32,
    column: u32,
    columns: u32,
    #[comptime] end: End,
) {
    let size = O::value().comptime();
    #[unroll]
    for vector in 0..comptime!(FOUR / size) {
        if column + comptime!((vector * size) as u32) < columns {
            let to = to as usize / size + vector;
            let mut written = Vector::<f32, O>::new(0.0f32);
            #[unroll]
            for part in 0..size {
                written.insert(part, sum.extract(comptime!(vector * size + part)));
            }
            if comptime!(matches!(end, End::Layer { .. })) {
                written += bias[column as usize / size + vector];
            }
            if comptime!(matches!(end, End::Layer { rectified: true })) {
                #[unroll]
                for part in 0..size {
                    written.insert(part, rectified(written.extract(part)));
                }
            }
            if comptime!(matches!(end, End::Adjoint { gated: true, .. })) {
                let gates = gate[at as usize / size + vector];
                #[unroll]
                for part in 0..size {
                    let closed = at_most_zero(gates.extract(part));
                    written.insert(part, select(closed, 0.0f32, written.extract(part)));
                }
            }
            if comptime!(matches!(end, End::Adjoint { added: true, .. })) {
                written += result[to];
            }
            result[to] = written;
        }
    }
}
