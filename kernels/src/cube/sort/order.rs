//! The digits of a cube's keys, counted in shared memory, and the order that follows from the counts.
//!
//! The counters of a digit and of the digit eight above it share a word. No count exceeds a block's keys, so the lower
//! half never carries into the upper half, and one addition updates both.

use cubecl::prelude::*;

use super::{DIGITS, SORT_BLOCK};
use crate::cube::UNITS;
use crate::cube::scan::{SCAN_SCRATCH, scan_units};

/// Number of digits in the lower halves of the words.
pub(super) const LOWER: usize = DIGITS / 2;
/// Bits of a counter.
pub(super) const COUNTER_BITS: u32 = 16;
pub(super) const COUNTER_MASK: u32 = (1 << COUNTER_BITS) - 1;
const _: () = assert!(SORT_BLOCK <= COUNTER_MASK as usize);
/// Words of a cube's counters, by digit, then by unit.
pub(super) const WORDS: usize = LOWER * UNITS;
/// Words that a unit sums: neighbours of the same digit.
const RUN: usize = WORDS / UNITS;
/// Units whose words belong to one digit.
pub(super) const DIGIT_UNITS: usize = UNITS / LOWER;

#[cube]
pub(super) fn clear(counters: &mut Shared<[u32]>) {
    for word in 0..LOWER {
        counters[word * UNITS + UNIT_POS as usize] = 0u32;
    }
}

/// Counts a key's digit in the unit's column of counters.
#[cube]
pub(super) fn count(counters: &mut Shared<[u32]>, key: u32, shift: u32) {
    let digit = digit_of(key, shift);
    counters[counter_of(digit)] += 1u32 << half_of(digit);
}

/// The sum of the unit's run of words.
#[cube]
pub(super) fn sum_of_run(counters: &Shared<[u32]>) -> u32 {
    let mut sum = 0u32;
    for i in UNIT_POS as usize * RUN..(UNIT_POS as usize + 1) * RUN {
        sum += counters[i];
    }
    sum
}

/// The order of a block's keys.
#[derive(CubeType)]
pub(super) struct Order {
    /// The position of the unit's next key of each digit within its half of the digits.
    positions: Shared<[u32]>,
    /// What is added to a key's place in its sorted block, by digit, see [`target_of`]. It wraps.
    pub bases: Shared<[u32]>,
    /// The number of keys with a digit of the lower half.
    in_lower: u32,
    pub shift: u32,
}

/// The order of a block whose digits are counted.
#[cube]
pub(super) fn order_of(counters: Shared<[u32]>, offsets: &[u32], shift: u32, blocks: u32) -> Order {
    let mut positions = counters;
    let mut scratch = Shared::<[u32]>::new_slice(SCAN_SCRATCH);
    let mut bases = Shared::<[u32]>::new_slice(DIGITS);
    let unit = UNIT_POS as usize;
    sync_cube();
    let (before, all) = scan_units(sum_of_run(&positions), &mut scratch);
    let in_lower = all & COUNTER_MASK;
    if unit % DIGIT_UNITS == 0 {
        #[unroll]
        for half in 0..2 {
            let digit = unit / DIGIT_UNITS + half * LOWER;
            bases[digit] = offsets[digit * blocks as usize + CUBE_POS] - place_of(before, digit, in_lower) as u32;
        }
    }
    let mut running = before;
    for i in unit * RUN..(unit + 1) * RUN {
        let next = positions[i];
        positions[i] = running;
        running += next;
    }
    sync_cube();
    Order { positions, bases, in_lower, shift }
}

/// The index that a key moves to from its place in its sorted block.
#[cube]
pub(super) fn target_of(bases: &Shared<[u32]>, digit: usize, place: usize) -> usize {
    (bases[digit] + place as u32) as usize
}

/// The place of the unit's next key in its sorted block.
#[cube]
pub(super) fn next_place(order: &mut Order, key: u32) -> usize {
    let digit = digit_of(key, order.shift);
    let positions = order.positions[counter_of(digit)];
    order.positions[counter_of(digit)] = positions + (1u32 << half_of(digit));
    place_of(positions, digit, order.in_lower)
}

/// The place in a sorted block, given the positions within both halves of the digits. `in_lower` keys have a digit of
/// the lower half.
#[cube]
fn place_of(positions: u32, digit: usize, in_lower: u32) -> usize {
    let position = (positions >> half_of(digit)) & COUNTER_MASK;
    select(digit < LOWER, position, position + in_lower) as usize
}

#[cube]
pub(super) fn digit_of(key: u32, shift: u32) -> usize {
    ((key >> shift) & comptime!(DIGITS as u32 - 1)) as usize
}

/// The index of the unit's counter of a digit.
#[cube]
fn counter_of(digit: usize) -> usize {
    digit % LOWER * UNITS + UNIT_POS as usize
}

/// The lowest bit of a digit's counter in its word.
#[cube]
pub(super) fn half_of(digit: usize) -> u32 {
    (digit / LOWER) as u32 * COUNTER_BITS
}
