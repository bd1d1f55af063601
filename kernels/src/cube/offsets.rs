//! Offsets side by side in a matrix, added to the attributes that they belong to, and the adjoint. CPU twin:
//! `offsets/cpu.rs`.
//!
//! The matrix has a block of columns for each of up to six attributes, `a` to `f`. An attribute has the first columns of
//! its block.

use cubecl::prelude::*;

/// Number of attributes.
pub const ATTRIBUTES: usize = 6;

/// A number for each attribute.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct EachAttribute {
    /// The first attribute's number.
    pub a: u32,
    /// The second one's.
    pub b: u32,
    /// The third one's.
    pub c: u32,
    /// The fourth one's.
    pub d: u32,
    /// The fifth one's.
    pub e: u32,
    /// The sixth one's.
    pub f: u32,
}

/// The sums of attributes and their offsets in `rows` rows, of which the matrix has `first` before them. `blocks` are the
/// widths of the blocks, and `widths` those of the attributes. A unit is one offset.
#[cube(launch_unchecked)]
pub fn add_offsets(
    offsets: &[f32],
    a: &[f32],
    b: &[f32],
    c: &[f32],
    d: &[f32],
    e: &[f32],
    f: &[f32],
    sum_a: &mut [f32],
    sum_b: &mut [f32],
    sum_c: &mut [f32],
    sum_d: &mut [f32],
    sum_e: &mut [f32],
    sum_f: &mut [f32],
    blocks: EachAttribute,
    widths: EachAttribute,
    first: u32,
    rows: u32,
) {
    let columns = columns_of(&blocks);
    let at = ABSOLUTE_POS as u32;
    if at < rows * columns {
        let (row, column) = (at / columns, at % columns);
        let offset = offsets[(first * columns + at) as usize];
        add_within(a, sum_a, offset, row, column, widths.a);
        // Behind the offset's own block, the column has wrapped, and is beyond every width. Before it, the column is beyond
        // the block, and no attribute is wider than its block.
        let column = column - blocks.a;
        add_within(b, sum_b, offset, row, column, widths.b);
        let column = column - blocks.b;
        add_within(c, sum_c, offset, row, column, widths.c);
        let column = column - blocks.c;
        add_within(d, sum_d, offset, row, column, widths.d);
        let column = column - blocks.d;
        add_within(e, sum_e, offset, row, column, widths.e);
        let column = column - blocks.e;
        add_within(f, sum_f, offset, row, column, widths.f);
    }
}

/// The adjoint of these rows of offsets for the cotangents of the sums. It is zero in columns that have none.
#[cube(launch_unchecked)]
pub fn join_cotangents(
    a: &[f32],
    b: &[f32],
    c: &[f32],
    d: &[f32],
    e: &[f32],
    f: &[f32],
    v_offsets: &mut [f32],
    blocks: EachAttribute,
    widths: EachAttribute,
    first: u32,
    rows: u32,
) {
    let columns = columns_of(&blocks);
    let at = ABSOLUTE_POS as u32;
    if at < rows * columns {
        let (row, column) = (at / columns, at % columns);
        let mut v = number_within(a, row, column, widths.a);
        let column = column - blocks.a;
        v += number_within(b, row, column, widths.b);
        let column = column - blocks.b;
        v += number_within(c, row, column, widths.c);
        let column = column - blocks.c;
        v += number_within(d, row, column, widths.d);
        let column = column - blocks.d;
        v += number_within(e, row, column, widths.e);
        let column = column - blocks.e;
        v += number_within(f, row, column, widths.f);
        v_offsets[(first * columns + at) as usize] = v;
    }
}

/// Columns of the matrix.
#[cube]
fn columns_of(blocks: &EachAttribute) -> u32 {
    blocks.a + blocks.b + blocks.c + blocks.d + blocks.e + blocks.f
}

/// Writes the sum if the attribute has the column.
#[cube]
fn add_within(attribute: &[f32], sums: &mut [f32], offset: f32, row: u32, column: u32, width: u32) {
    if column < width {
        let at = (row * width + column) as usize;
        sums[at] = attribute[at] + offset;
    }
}

/// A number of a matrix; zero beyond its columns.
#[cube]
fn number_within(matrix: &[f32], row: u32, column: u32, width: u32) -> f32 {
    let mut number = 0.0f32;
    if column < width {
        number = matrix[(row * width + column) as usize];
    }
    number
}
