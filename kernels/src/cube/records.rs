//! The sums of a Gaussian's gradient records.
//!
//! A Gaussian that fills the image has thousands of records, and one unit would add them long after all others have
//! ended. On a GPU, a launch before therefore sums every [`PIECE`] consecutive records, whoever owns them. A Gaussian then
//! adds the sums of the pieces that are wholly its own, and single records at both ends.

use cubecl::prelude::*;

use super::backward_kind::record_vectors;
use super::stage::Four;

/// Records of a piece.
pub const PIECE: usize = 32;

/// Pieces of so many records: whole ones alone.
pub const fn piece_count(records: usize) -> usize {
    records / PIECE
}

/// Sums the records of each piece. `slots` are those of `project_backward`, whose positions begin at `head`. `gradients`
/// has a row for each of the `pairs`, and behind them one for each piece. A unit sums a vector of a piece.
#[cube(launch_unchecked)]
pub fn sum_pieces(slots: &[i32], gradients: &mut [Four], head: u32, pairs: u32, #[comptime] channels: usize) {
    let vectors = comptime!(record_vectors(channels));
    let (piece, vector) = (ABSOLUTE_POS / vectors, ABSOLUTE_POS % vectors);
    if piece < pairs as usize / PIECE {
        let first = head as usize + piece * PIECE;
        let mut sum = Four::new(0.0f32);
        for slot in first..first + PIECE {
            sum += gradients[slots[slot] as usize * vectors + vector];
        }
        gradients[(pairs as usize + piece) * vectors + vector] = sum;
    }
}

/// The sum of the records in the slots from `begin` to before `end`, in their order. `head` is where the positions begin.
/// With `pieced`, [`sum_pieces`] has summed the pieces of the `pairs` records.
#[cube]
pub(super) fn sum_of_records(
    slots: &[i32],
    gradients: &[Four],
    begin: u32,
    end: u32,
    head: u32,
    pairs: u32,
    #[comptime] pieced: bool,
    #[comptime] channels: usize,
) -> Array<Four> {
    let vectors = comptime!(record_vectors(channels));
    let mut sums = Array::<Four>::new(vectors);
    #[unroll]
    for vector in 0..vectors {
        sums[vector] = Four::new(0.0f32);
    }
    if comptime!(pieced) {
        let piece = comptime!(PIECE as u32);
        let (first, last) = ((begin + piece - 1u32) / piece, end / piece);
        let has_whole = first < last;
        let (own_end, rest) = (select(has_whole, first * piece, end), select(has_whole, last * piece, end));
        add_slots(slots, gradients, &mut sums, head + begin, head + own_end, channels);
        let mut at = first;
        while at < last {
            add_row(gradients, &mut sums, pairs as usize + at as usize, channels);
            at += 1u32;
        }
        add_slots(slots, gradients, &mut sums, head + rest, head + end, channels);
    } else {
        add_slots(slots, gradients, &mut sums, head + begin, head + end, channels);
    }
    sums
}

#[cube]
fn add_slots(
    slots: &[i32],
    gradients: &[Four],
    sums: &mut Array<Four>,
    begin: u32,
    end: u32,
    #[comptime] channels: usize,
) {
    for slot in begin..end {
        add_row(gradients, sums, slots[slot as usize] as usize, channels);
    }
}

#[cube]
fn add_row(gradients: &[Four], sums: &mut Array<Four>, row: usize, #[comptime] channels: usize) {
    let vectors = comptime!(record_vectors(channels));
    #[unroll]
    for vector in 0..vectors {
        sums[vector] += gradients[row * vectors + vector];
    }
}
