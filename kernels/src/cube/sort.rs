//! A stable radix sort of key-number pairs, four bits per pass. Each unit counts the digits of its own run of keys. The
//! sort therefore needs neither atomics nor subgroups, and its result is deterministic.
//!
//! A pass consists of `count_digits` for each block, prefix sums over digits and blocks (see the module `scan`), and
//! `move_keys`.
//!
//! Within a cube, the counters of a digit and of the digit eight above it share a word. No count exceeds a block's
//! keys, so the lower half never carries into the upper half, and one addition updates both.
//!
//! The keys of a digit stay together within a block. A GPU with enough shared memory therefore sorts the block there
//! first: units that are neighbours then write neighbouring memory.

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
/// Bits of a key's place in its sorted block, in half a word.
const PLACE_BITS: usize = 16;
const WORD_BITS: usize = 32;
const _: () = assert!(SORT_BLOCK <= 1 << PLACE_BITS);
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
pub const STAGED_BYTES: usize = (SORT_BLOCK + WORDS + SCAN_SCRATCH + DIGITS) * size_of::<u32>();

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
    let mut scratch = Shared::<[u32]>::new_slice(SCAN_SCRATCH);
    // What is added to a key's place in its sorted block, by digit, see `target_of`. It wraps.
    let mut bases = Shared::<[u32]>::new_slice(DIGITS);
    if CUBE_POS < blocks as usize {
        count_run(keys, total[0], shift, &mut counters);
        let unit = UNIT_POS as usize;
        // From here on, a counter is the position of the unit's next key of that digit within its half of the digits.
        let (before, all) = scan_units(sum_of_run(&counters), &mut scratch);
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
            let next = counters[i];
            counters[i] = running;
            running += next;
        }
        sync_cube();
        let first = CUBE_POS * SORT_BLOCK;
        let count = min(max(total[0] as usize, first) - first, SORT_BLOCK);
        if comptime!(kind.staged) {
            move_sorted(
                keys,
                numbers,
                moved_keys,
                moved_numbers,
                &mut counters,
                &bases,
                (first, count),
                in_lower,
                shift,
                kind,
            );
        } else {
            for from in unit * ITEMS..min((unit + 1) * ITEMS, count) {
                let key = keys[first + from];
                let digit = digit_of(key, shift);
                let target = target_of(&bases, digit, next_place(&mut counters, digit, in_lower));
                moved_keys[target] = key;
                moved_numbers[target] = number_at(numbers, first + from, kind);
            }
        }
    }
}

/// Moves the `count` keys of a block that begins at `first`, and their numbers, by way of the sorted block in shared
/// memory. For `in_lower`, see [`place_of`].
#[cube]
fn move_sorted(
    keys: &[u32],
    numbers: &[u32],
    moved_keys: &mut [u32],
    moved_numbers: &mut [u32],
    counters: &mut Shared<[u32]>,
    bases: &Shared<[u32]>,
    block: (usize, usize),
    in_lower: u32,
    shift: u32,
    #[comptime] kind: MoveKind,
) {
    let (first, count) = block;
    let unit = UNIT_POS as usize;
    let mut staged = Shared::<[u32]>::new_slice(SORT_BLOCK);
    // Where the unit's keys went, and the digits of those that it writes.
    let mut places = packed_zeros(PLACE_BITS);
    let mut digits = packed_zeros(DIGIT_BITS);
    #[unroll]
    for i in 0..ITEMS {
        let from = unit * ITEMS + i;
        if from < count {
            let key = keys[first + from];
            let place = next_place(counters, digit_of(key, shift), in_lower);
            staged[place] = key;
            pack(&mut places, i, place, PLACE_BITS);
        }
    }
    sync_cube();
    #[unroll]
    for i in 0..ITEMS {
        let place = i * UNITS + unit;
        if place < count {
            let key = staged[place];
            let digit = digit_of(key, shift);
            moved_keys[target_of(bases, digit, place)] = key;
            pack(&mut digits, i, digit, DIGIT_BITS);
        }
    }
    sync_cube();
    #[unroll]
    for i in 0..ITEMS {
        let from = unit * ITEMS + i;
        if from < count {
            staged[unpack(&places, i, PLACE_BITS)] = number_at(numbers, first + from, kind);
        }
    }
    sync_cube();
    #[unroll]
    for i in 0..ITEMS {
        let place = i * UNITS + unit;
        if place < count {
            moved_numbers[target_of(bases, unpack(&digits, i, DIGIT_BITS), place)] = staged[place];
        }
    }
}

/// The index that a key moves to from its place in its sorted block.
#[cube]
fn target_of(bases: &Shared<[u32]>, digit: usize, place: usize) -> usize {
    (bases[digit] + place as u32) as usize
}

/// The place of the unit's next key of a digit in its sorted block.
#[cube]
fn next_place(counters: &mut Shared<[u32]>, digit: usize, in_lower: u32) -> usize {
    let at = digit % LOWER * UNITS + UNIT_POS as usize;
    let positions = counters[at];
    counters[at] = positions + (1u32 << half_of(digit));
    place_of(positions, digit, in_lower)
}

/// The place in a sorted block, given the positions within both halves of the digits. `in_lower` keys have a digit of
/// the lower half.
#[cube]
fn place_of(positions: u32, digit: usize, in_lower: u32) -> usize {
    let position = (positions >> half_of(digit)) & COUNTER_MASK;
    select(digit < LOWER, position, position + in_lower) as usize
}

/// Zeros of so many bits each for the unit's keys, packed into words, which take fewer registers.
#[cube]
fn packed_zeros(#[comptime] bits: usize) -> Array<u32> {
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
fn pack(packed: &mut Array<u32>, #[comptime] i: usize, number: usize, #[comptime] bits: usize) {
    let (word, shift) = comptime!((i / (WORD_BITS / bits), (i % (WORD_BITS / bits) * bits) as u32));
    packed[word] |= (number as u32) << shift;
}

/// The packed number of key `i`.
#[cube]
fn unpack(packed: &Array<u32>, #[comptime] i: usize, #[comptime] bits: usize) -> usize {
    let (word, shift) = comptime!((i / (WORD_BITS / bits), (i % (WORD_BITS / bits) * bits) as u32));
    ((packed[word] >> shift) & comptime!((1u32 << bits) - 1)) as usize
}

#[cube]
fn number_at(numbers: &[u32], index: usize, #[comptime] kind: MoveKind) -> u32 {
    if comptime!(kind.numbered) { numbers[index] } else { index as u32 }
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
