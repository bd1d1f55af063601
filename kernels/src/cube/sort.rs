//! A stable radix sort of keys with numbers, four bits at a time. Each unit counts the digits of its own run of keys,
//! so the sort needs neither atomics nor vectors of units, and its result has one order.
//!
//! A pass: `count_digits` for each block, running sums over digits and blocks (see the module `scan`), `move_keys`.

use cubecl::prelude::*;

use super::UNITS;
use super::scan::{SCAN_ROOM, scan_units};

/// Bits of a digit.
pub const DIGIT_BITS: usize = 4;
/// Values of a digit.
pub const DIGITS: usize = 1 << DIGIT_BITS;
/// Keys that a unit takes: as many as there are digits, so that counting costs no more than moving.
const ITEMS: usize = DIGITS;
/// Keys that a cube takes.
pub const SORT_BLOCK: usize = UNITS * ITEMS;
const _: () = assert!(DIGITS * DIGITS == UNITS, "a unit sums as many counters as there are digits");
/// Counters of a cube, by digit, then by unit.
const COUNTERS: usize = DIGITS * UNITS;

/// How often each digit occurs in each block: `counts` `[DIGITS, blocks]`. `total[0]` is the number of keys.
#[cube(launch_unchecked)]
pub fn count_digits(keys: &[u32], total: &[u32], counts: &mut [u32], shift: u32, blocks: u32) {
    let mut counters = Shared::<[u32]>::new_slice(COUNTERS);
    let mut sums = Shared::<[u32]>::new_slice(UNITS);
    if CUBE_POS < blocks as usize {
        count_run(keys, total[0], shift, &mut counters);
        sync_cube();
        // A unit sums sixteen counters of one digit, sixteen units make a digit's sum.
        let unit = UNIT_POS as usize;
        let mut sum = 0u32;
        for i in unit * DIGITS..(unit + 1) * DIGITS {
            sum += counters[i];
        }
        sums[unit] = sum;
        sync_cube();
        if unit < DIGITS {
            let mut sum = 0u32;
            for i in unit * comptime!(UNITS / DIGITS)..(unit + 1) * comptime!(UNITS / DIGITS) {
                sum += sums[i];
            }
            counts[unit * blocks as usize + CUBE_POS] = sum;
        }
    }
}

/// Moves keys and numbers to their places. `offsets` `[DIGITS, blocks]` are the running sums of the counts.
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
    let mut counters = Shared::<[u32]>::new_slice(COUNTERS);
    let mut room = Shared::<[u32]>::new_slice(SCAN_ROOM);
    let mut firsts = Shared::<[u32]>::new_slice(DIGITS);
    if CUBE_POS < blocks as usize {
        count_run(keys, total[0], shift, &mut counters);
        sync_cube();
        let unit = UNIT_POS as usize;
        let mut own = 0u32;
        for i in unit * DIGITS..(unit + 1) * DIGITS {
            own += counters[i];
        }
        let (before, _) = scan_units(own, &mut room);
        let mut running = before;
        for i in unit * DIGITS..(unit + 1) * DIGITS {
            let next = counters[i];
            counters[i] = running;
            running += next;
        }
        if unit % comptime!(UNITS / DIGITS) == 0 {
            firsts[unit / comptime!(UNITS / DIGITS)] = before;
        }
        sync_cube();
        let begin = CUBE_POS * SORT_BLOCK + unit * ITEMS;
        for i in begin..begin + ITEMS {
            if i < total[0] as usize {
                let key = keys[i];
                let digit = digit_of(key, shift);
                let counter = digit * UNITS + unit;
                let place = counters[counter];
                counters[counter] = place + 1u32;
                let target = (offsets[digit * blocks as usize + CUBE_POS] + place - firsts[digit]) as usize;
                moved_keys[target] = key;
                moved_numbers[target] = numbers[i];
            }
        }
    }
}

/// Counts the digits of the unit's own keys in its own column of counters.
#[cube]
fn count_run(keys: &[u32], total: u32, shift: u32, counters: &mut Shared<[u32]>) {
    let unit = UNIT_POS as usize;
    for digit in 0..DIGITS {
        counters[digit * UNITS + unit] = 0u32;
    }
    let begin = CUBE_POS * SORT_BLOCK + unit * ITEMS;
    for i in begin..begin + ITEMS {
        if i < total as usize {
            let counter = digit_of(keys[i], shift) * UNITS + unit;
            counters[counter] += 1u32;
        }
    }
}

#[cube]
fn digit_of(key: u32, shift: u32) -> usize {
    ((key >> shift) & comptime!(DIGITS as u32 - 1)) as usize
}
