//! Exclusive prefix sums of integers in three steps. Each cube sums its block. The blocks' sums are scanned in the same
//! way, until one block is left. Then each cube scans its block from there.
//!
//! Sums saturate at the largest 32-bit value, so that the host can detect overflow.

use cubecl::prelude::*;

use super::UNITS;

/// Number of units whose sums one unit adds in a cube's scan: the square root of [`UNITS`].
const GROUP: usize = 16;
/// Values per unit.
const ITEMS: usize = 8;
/// Values per cube.
pub const SCAN_BLOCK: usize = UNITS * ITEMS;
const _: () = assert!(GROUP * GROUP == UNITS);
/// Values in the scratch memory of a cube's scan.
pub const SCAN_SCRATCH: usize = UNITS + GROUP + 1;

/// The sum of each block of [`SCAN_BLOCK`] values.
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

/// The sum of the values before each one, `sums` `[count]`, and of all, `total` `[1]`. `before` is the sum before each
/// block. It is not read if there is only `one` block.
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

/// Index of the unit's first value.
#[cube]
fn first_item() -> usize {
    CUBE_POS * SCAN_BLOCK + UNIT_POS as usize * ITEMS
}

/// The sum of the unit's values, of `count` values in total.
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

/// The saturating sum.
#[cube]
fn capped_sum(a: u32, b: u32) -> u32 {
    let sum = a + b;
    select(sum < a, u32::MAX, sum)
}

/// The sum over the units before this one, and over all units. Every unit of the cube must call this.
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
    // From here on, the scratch memory may be reused.
    sync_cube();
    (before, total)
}
