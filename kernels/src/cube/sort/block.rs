//! The keys of a cube, in registers and in shared memory.

use cubecl::prelude::*;

use super::{ITEMS, SORT_BLOCK};
use crate::cube::UNITS;

const WORD_BITS: usize = 32;
/// Words of a block in shared memory, see [`padded`].
pub const STAGED_WORDS: usize = SORT_BLOCK + SORT_BLOCK / ITEMS;

/// The keys of a cube.
#[derive(CubeType)]
pub(super) struct Block {
    pub first: usize,
    pub count: usize,
}

#[cube]
pub(super) fn block_of(total: u32) -> Block {
    let first = CUBE_POS * SORT_BLOCK;
    Block { first, count: min(max(total as usize, first) - first, SORT_BLOCK) }
}

/// The index in a block of the unit's key `i`, if neighbouring units take neighbouring keys.
#[cube]
pub(super) fn in_turn(#[comptime] i: usize) -> usize {
    i * UNITS + UNIT_POS as usize
}

/// The index in a block of the unit's key `i`, if each unit takes a run of keys.
#[cube]
pub(super) fn in_run(#[comptime] i: usize) -> usize {
    UNIT_POS as usize * ITEMS + i
}

/// The index in shared memory of a place in a block. A word is left out after each run: otherwise, units whose places are
/// a run apart would access the same bank.
#[cube]
pub(super) fn padded(place: usize) -> usize {
    place + place / ITEMS
}

/// The unit's values of a block, see [`in_turn`]. All are requested before any is needed.
#[cube]
pub(super) fn read_in_turn(values: &[u32], block: &Block) -> Array<u32> {
    let mut read = Array::<u32>::new(ITEMS);
    #[unroll]
    for i in 0..ITEMS {
        read[i] = 0u32;
        if in_turn(i) < block.count {
            read[i] = values[block.first + in_turn(i)];
        }
    }
    read
}

/// Copies the values of a block to shared memory. Units that are neighbours read neighbouring memory.
#[cube]
pub(super) fn stage(values: &[u32], block: &Block, staged: &mut Shared<[u32]>) {
    let read = read_in_turn(values, block);
    #[unroll]
    for i in 0..ITEMS {
        staged[padded(in_turn(i))] = read[i];
    }
}

/// The unit's values of a staged block, see [`in_run`].
#[cube]
pub(super) fn run_of(staged: &mut Shared<[u32]>) -> Array<u32> {
    let mut run = Array::<u32>::new(ITEMS);
    #[unroll]
    for i in 0..ITEMS {
        run[i] = staged[padded(in_run(i))];
    }
    run
}

/// Zeros of so many bits each for the unit's keys, packed into words, which take fewer registers.
#[cube]
pub(super) fn packed_zeros(#[comptime] bits: usize) -> Array<u32> {
    let words = comptime!(ITEMS.div_ceil(WORD_BITS / bits));
    let mut packed = Array::<u32>::new(words);
    #[unroll]
    for word in 0..words {
        packed[word] = 0u32;
    }
    packed
}

/// Sets the packed number of key `i`, which is zero.
#[cube]
pub(super) fn pack(packed: &mut Array<u32>, #[comptime] i: usize, number: usize, #[comptime] bits: usize) {
    let (word, shift) = comptime!((i / (WORD_BITS / bits), (i % (WORD_BITS / bits) * bits) as u32));
    packed[word] |= (number as u32) << shift;
}

/// The packed number of key `i`.
#[cube]
pub(super) fn unpack(packed: &Array<u32>, #[comptime] i: usize, #[comptime] bits: usize) -> usize {
    let (word, shift) = comptime!((i / (WORD_BITS / bits), (i % (WORD_BITS / bits) * bits) as u32));
    ((packed[word] >> shift) & comptime!((1u32 << bits) - 1)) as usize
}
