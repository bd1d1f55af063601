//! A stable radix sort of key-number pairs, four bits per pass. Each unit counts the digits of its own run of keys. The
//! sort therefore needs neither atomics nor subgroups, and its result is deterministic.
//!
//! A pass consists of `count_digits` for each block, prefix sums over digits and blocks (see the module `scan`), and
//! `move_keys`.
//!
//! Within a cube, the counters of a digit and of the digit eight above it share a word. No count exceeds a block's
//! keys, so the lower half never carries into the upper half, and one addition updates both.

use cubecl::prelude::*;

use super::UNITS;
use super::scan::{SCAN_SCRATCH, scan_units};

/// Bits of a digit.
pub const DIGIT_BITS: usize = 4;
/// Values of a digit.
pub const DIGITS: usize = 1 << DIGIT_BITS;
/// Number of digits in the lower halves of the words.
const LOWER: usize = DIGITS / 2;
/// Keys per unit.
const ITEMS: usize = 16;
/// Keys per cube.
pub const SORT_BLOCK: usize = UNITS * ITEMS;
/// Bits of a counter.
const COUNTER_BITS: u32 = 16;
const COUNTER_MASK: u32 = (1 << COUNTER_BITS) - 1;
const _: () = assert!(SORT_BLOCK <= COUNTER_MASK as usize);
/// Words of a cube's counters, by digit, then by unit.
const WORDS: usize = LOWER * UNITS;
/// Words that a unit sums: neighbours of the same digit.
const RUN: usize = WORDS / UNITS;
/// Units whose words belong to one digit.
const DIGIT_UNITS: usize = UNITS / LOWER;

/// Counts each digit in each block: `counts` `[DIGITS, blocks]`. `total[0]` is the number of keys.
#[cube(launch_unchecked)]
pub fn count_digits(keys: &[u32], total: &[u32], counts: &mut [u32], shift: u32, blocks: u32) {
    let mut counters = Shared::<[u32]>::new_slice(WORDS);
    let mut sums = Shared::<[u32]>::new_slice(UNITS);
    if CUBE_POS < blocks as usize {
        count_run(keys, total[0], shift, &mut counters);
        let unit = UNIT_POS as usize;
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
) {
    let mut counters = Shared::<[u32]>::new_slice(WORDS);
    let mut scratch = Shared::<[u32]>::new_slice(SCAN_SCRATCH);
    let mut firsts = Shared::<[u32]>::new_slice(LOWER);
    if CUBE_POS < blocks as usize {
        count_run(keys, total[0], shift, &mut counters);
        let unit = UNIT_POS as usize;
        // From here on, a counter is the position of the unit's next key of that digit within its half of the digits.
        let (before, _) = scan_units(sum_of_run(&counters), &mut scratch);
        if unit % DIGIT_UNITS == 0 {
            firsts[unit / DIGIT_UNITS] = before;
        }
        let mut running = before;
        for i in unit * RUN..(unit + 1) * RUN {
            let next = counters[i];
            counters[i] = running;
            running += next;
        }
        sync_cube();
        let begin = CUBE_POS * SORT_BLOCK + unit * ITEMS;
        for i in begin..begin + ITEMS {
            if i < total[0] as usize {
                let key = keys[i];
                let digit = digit_of(key, shift);
                let (word, half) = (digit % LOWER, half_of(digit));
                let place = counters[word * UNITS + unit];
                counters[word * UNITS + unit] = place + (1u32 << half);
                // Both halves are subtracted at once; a digit's positions never precede its first.
                let rank = ((place - firsts[word]) >> half) & COUNTER_MASK;
                let target = (offsets[digit * blocks as usize + CUBE_POS] + rank) as usize;
                moved_keys[target] = key;
                moved_numbers[target] = numbers[i];
            }
        }
    }
}

/// Counts the digits of each unit's keys in the unit's column of counters. All units can read the counters afterwards.
#[cube]
fn count_run(keys: &[u32], total: u32, shift: u32, counters: &mut Shared<[u32]>) {
    let unit = UNIT_POS as usize;
    for word in 0..LOWER {
        counters[word * UNITS + unit] = 0u32;
    }
    let begin = CUBE_POS * SORT_BLOCK + unit * ITEMS;
    for i in begin..begin + ITEMS {
        if i < total as usize {
            let digit = digit_of(keys[i], shift);
            counters[digit % LOWER * UNITS + unit] += 1u32 << half_of(digit);
        }
    }
    sync_cube();
}

/// The sum of the unit's run of words.
#[cube]
fn sum_of_run(counters: &Shared<[u32]>) -> u32 {
    let mut sum = 0u32;
    for i in UNIT_POS as usize * RUN..(UNIT_POS as usize + 1) * RUN {
        sum += counters[i];
    }
    sum
}

#[cube]
fn digit_of(key: u32, shift: u32) -> usize {
    ((key >> shift) & comptime!(DIGITS as u32 - 1)) as usize
}

/// The lowest bit of a digit's counter in its word.
#[cube]
fn half_of(digit: usize) -> u32 {
    (digit / LOWER) as u32 * COUNTER_BITS
}
