//! A stable radix sort of key-number pairs, four bits per pass. Each unit counts the digits of its own run of keys. The
//! sort therefore needs neither atomics nor subgroups, and its result is deterministic.
//!
//! A pass consists of `count_digits` for each block, prefix sums over digits and blocks (see the module `scan`), and
//! `move_keys`.
//!
//! The keys of a digit stay together within a block. A GPU with enough shared memory therefore sorts the block there
//! first: units that are neighbours then write neighbouring memory.

mod block;
mod order;

use cubecl::prelude::*;

use self::block::{
    Block, STAGED_WORDS, block_of, in_run, in_turn, pack, packed_zeros, padded, read_in_turn, run_of, stage, unpack,
};
use self::order::{
    COUNTER_BITS, COUNTER_MASK, DIGIT_UNITS, LOWER, Order, WORDS, clear, count, digit_of, next_place, order_of,
    sum_of_run, target_of,
};
use super::UNITS;
use super::scan::SCAN_SCRATCH;

/// Bits of a digit.
pub const DIGIT_BITS: usize = 4;
/// Values of a digit.
pub const DIGITS: usize = 1 << DIGIT_BITS;
/// Keys per unit.
const ITEMS: usize = 16;
/// Keys per cube.
pub const SORT_BLOCK: usize = UNITS * ITEMS;
/// Bits of a place in a block.
const PLACE_BITS: usize = 16;
const _: () = assert!(SORT_BLOCK <= 1 << PLACE_BITS);

/// Counts each digit in each block: `counts` `[DIGITS, blocks]`. `total[0]` is the number of keys.
#[cube(launch_unchecked)]
pub fn count_digits(keys: &[u32], total: &[u32], counts: &mut [u32], shift: u32, blocks: u32) {
    let mut counters = Shared::<[u32]>::new_slice(WORDS);
    let mut sums = Shared::<[u32]>::new_slice(UNITS);
    if CUBE_POS < blocks as usize {
        let unit = UNIT_POS as usize;
        let block = block_of(total[0]);
        clear(&mut counters);
        let read = read_in_turn(keys, &block);
        #[unroll]
        for i in 0..ITEMS {
            if in_turn(i) < block.count {
                count(&mut counters, read[i], shift);
            }
        }
        sync_cube();
        sums[unit] = sum_of_run(&counters);
        sync_cube();
        if unit < LOWER {
            let mut sum = 0u32;
            for i in unit * DIGIT_UNITS..(unit + 1) * DIGIT_UNITS {
                sum += sums[i];
            }
            counts[unit * blocks as usize + CUBE_POS] = sum & COUNTER_MASK;
            counts[(unit + LOWER) * blocks as usize + CUBE_POS] = sum >> COUNTER_BITS;
        }
    }
}

/// Compile-time parameters of [`move_keys()`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MoveKind {
    /// Whether a block is sorted in shared memory before it is written, which takes [`STAGED_BYTES`]. A driver that
    /// computes on the CPU gains nothing from it.
    pub staged: bool,
    /// Whether the keys have numbers already. Otherwise their indices become their numbers.
    pub numbered: bool,
}

/// Bytes of shared memory that [`move_keys()`] needs to sort blocks there.
pub const STAGED_BYTES: usize = (STAGED_WORDS + WORDS + SCAN_SCRATCH + DIGITS) * size_of::<u32>();

/// Moves keys and numbers to their places. `offsets` `[DIGITS, blocks]` are the prefix sums of the counts.
#[cube(launch_unchecked)]
pub fn move_keys(
    keys: &[u32],
    numbers: &[u32],
    total: &[u32],
    offsets: &[u32],
    moved_keys: &mut [u32],
    moved_numbers: &mut [u32],
    shift: u32,
    blocks: u32,
    #[comptime] kind: MoveKind,
) {
    let mut counters = Shared::<[u32]>::new_slice(WORDS);
    if CUBE_POS < blocks as usize {
        let block = block_of(total[0]);
        clear(&mut counters);
        if comptime!(kind.staged) {
            let mut staged = Shared::<[u32]>::new_slice(STAGED_WORDS);
            stage(keys, &block, &mut staged);
            sync_cube();
            #[unroll]
            for i in 0..ITEMS {
                if in_run(i) < block.count {
                    count(&mut counters, staged[padded(in_run(i))], shift);
                }
            }
            let mut order = order_of(counters, offsets, shift, blocks);
            move_sorted(numbers, moved_keys, moved_numbers, &mut order, &mut staged, &block, kind);
        } else {
            let end = min(in_run(ITEMS), block.count);
            for i in in_run(0usize)..end {
                count(&mut counters, keys[block.first + i], shift);
            }
            let mut order = order_of(counters, offsets, shift, blocks);
            for i in in_run(0usize)..end {
                let key = keys[block.first + i];
                let place = next_place(&mut order, key);
                let target = target_of(&order.bases, digit_of(key, shift), place);
                moved_keys[target] = key;
                moved_numbers[target] = number_at(numbers, block.first + i, kind);
            }
        }
    }
}

/// Moves the keys of a staged block, and their numbers, by way of the sorted block.
#[cube]
fn move_sorted(
    numbers: &[u32],
    moved_keys: &mut [u32],
    moved_numbers: &mut [u32],
    order: &mut Order,
    staged: &mut Shared<[u32]>,
    block: &Block,
    #[comptime] kind: MoveKind,
) {
    // Where the unit's keys go, and the digits of those that it writes.
    let mut places = packed_zeros(PLACE_BITS);
    let mut digits = packed_zeros(DIGIT_BITS);
    let keys = run_of(staged);
    sync_cube();
    #[unroll]
    for i in 0..ITEMS {
        if in_run(i) < block.count {
            let place = next_place(order, keys[i]);
            staged[padded(place)] = keys[i];
            pack(&mut places, i, place, PLACE_BITS);
        }
    }
    sync_cube();
    #[unroll]
    for i in 0..ITEMS {
        let place = in_turn(i);
        if place < block.count {
            let key = staged[padded(place)];
            let digit = digit_of(key, order.shift);
            moved_keys[target_of(&order.bases, digit, place)] = key;
            pack(&mut digits, i, digit, DIGIT_BITS);
        }
    }
    sync_cube();
    let numbers = numbers_of_run(numbers, block, staged, kind);
    #[unroll]
    for i in 0..ITEMS {
        if in_run(i) < block.count {
            staged[padded(unpack(&places, i, PLACE_BITS))] = numbers[i];
        }
    }
    sync_cube();
    #[unroll]
    for i in 0..ITEMS {
        let place = in_turn(i);
        if place < block.count {
            moved_numbers[target_of(&order.bases, unpack(&digits, i, DIGIT_BITS), place)] = staged[padded(place)];
        }
    }
}

/// The numbers of the unit's run of keys. All units can write to `staged` afterwards.
#[cube]
fn numbers_of_run(
    numbers: &[u32],
    block: &Block,
    staged: &mut Shared<[u32]>,
    #[comptime] kind: MoveKind,
) -> Array<u32> {
    if comptime!(kind.numbered) {
        stage(numbers, block, staged);
        sync_cube();
        let run = run_of(staged);
        sync_cube();
        run
    } else {
        let mut run = Array::<u32>::new(ITEMS);
        #[unroll]
        for i in 0..ITEMS {
            run[i] = (block.first + in_run(i)) as u32;
        }
        run
    }
}

#[cube]
fn number_at(numbers: &[u32], index: usize, #[comptime] kind: MoveKind) -> u32 {
    if comptime!(kind.numbered) { numbers[index] } else { index as u32 }
}
