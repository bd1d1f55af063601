//! Running sums of whole numbers, in three steps: each cube sums its block, the blocks' sums are scanned (by the same
//! steps, until one block is left), and each cube scans its block from there.
//!
//! A sum that 32 bits do not hold stays at their largest number, so that the host can tell that it is too large.

use cubecl::prelude::*;

use super::UNITS;

/// Units that one unit sums up in a cube's scan: the square root of [`UNITS`].
const GROUP: usize = 16;
/// Numbers that a unit takes.
const ITEMS: usize = 8;
/// Numbers that a cube takes.
pub const SCAN_BLOCK: usize = UNITS * ITEMS;
const _: () = assert!(GROUP * GROUP == UNITS);
/// Numbers that a cube's scan needs beside its own.
pub const SCAN_SCRATCH: usize = UNITS + GROUP + 1;

/// The sum of each block of [`SCAN_BLOCK`] numbers.
#[cube(launch)]
pub fn sum_blocks(values: &[u32], sums: &mut [u32], count: u32, blocks: u32) {
    let mut scratch = Shared::<[u32]>::new_slice(SCAN_SCRATCH);
    if CUBE_POS < blocks as usize {
        let (_, total) = scan_units(sum_of_items(values, count), &mut scratch);
        if UNIT_POS == 0u32 {
            sums[CUBE_POS] = total;
        }
    }
}

/// The sum of the numbers before each, `[count]`, and that of all, `[1]`. `before` is the sum before each block; if
/// there is `one` block it is not read.
#[cube(launch)]
pub fn scan_blocks(
    values: &[u32],
    before: &[u32],
    sums: &mut [u32],
    total: &mut [u32],
    count: u32,
    blocks: u32,
    #[comptime] one: bool,
) {
    let mut scratch = Shared::<[u32]>::new_slice(SCAN_SCRATCH);
    if CUBE_POS < blocks as usize {
        let (offset, _) = scan_units(sum_of_items(values, count), &mut scratch);
        let mut running = offset;
        if !one {
            running = capped_sum(running, before[CUBE_POS]);
        }
        let first = first_item();
        for i in first..first + ITEMS {
            if i < count as usize {
                sums[i] = running;
                running = capped_sum(running, values[i]);
                if i + 1 == count as usize {
                    total[0] = running;
                }
            }
        }
    }
}

/// The first number that the unit takes.
#[cube]
fn first_item() -> usize {
    CUBE_POS * SCAN_BLOCK + UNIT_POS as usize * ITEMS
}

/// The sum of the numbers that the unit takes, of which there are `count`.
#[cube]
fn sum_of_items(values: &[u32], count: u32) -> u32 {
    let first = first_item();
    let mut sum = 0u32;
    for i in first..first + ITEMS {
        if i < count as usize {
            sum = capped_sum(sum, values[i]);
        }
    }
    sum
}

/// The sum, or the largest number if that is larger.
#[cube]
fn capped_sum(a: u32, b: u32) -> u32 {
    let sum = a + b;
    select(sum < a, u32::MAX, sum)
}

/// The sum over the units before this one, and over all units. Every unit of the cube has to come here.
#[cube]
pub fn scan_units(value: u32, scratch: &mut Shared<[u32]>) -> (u32, u32) {
    let unit = UNIT_POS as usize;
    scratch[unit] = value;
    sync_cube();
    if unit < GROUP {
        let mut sum = 0u32;
        for i in unit * GROUP..(unit + 1) * GROUP {
            let next = scratch[i];
            scratch[i] = sum;
            sum = capped_sum(sum, next);
        }
        scratch[UNITS + unit] = sum;
    }
    sync_cube();
    if unit == 0 {
        let mut sum = 0u32;
        for i in UNITS..UNITS + GROUP {
            let next = scratch[i];
            scratch[i] = sum;
            sum = capped_sum(sum, next);
        }
        scratch[UNITS + GROUP] = sum;
    }
    sync_cube();
    let before = capped_sum(scratch[unit], scratch[UNITS + unit / GROUP]);
    let total = scratch[UNITS + GROUP];
    // The scratch may be used again.
    sync_cube();
    (before, total)
}
