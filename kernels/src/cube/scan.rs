//! Running sums of whole numbers, in three steps: each cube sums its block, the blocks' sums are scanned (by the same
//! steps, until one block is left), and each cube scans its block from there.

use cubecl::prelude::*;

use super::UNITS;

/// Units that one unit sums up in a cube's scan: the square root of [`UNITS`].
const GROUP: usize = 16;
/// Numbers that a unit takes.
const ITEMS: usize = 8;
/// Numbers that a cube takes.
pub const SCAN_BLOCK: usize = UNITS * ITEMS;
const _: () = assert!(GROUP * GROUP == UNITS);
/// Room of a cube's scan.
pub const SCAN_ROOM: usize = UNITS + GROUP + 1;

/// The sum of each block of [`SCAN_BLOCK`] numbers.
#[cube(launch)]
pub fn sum_blocks(values: &[u32], sums: &mut [u32], count: u32, blocks: u32) {
    let mut room = Shared::<[u32]>::new_slice(SCAN_ROOM);
    if CUBE_POS < blocks as usize {
        let first = CUBE_POS * SCAN_BLOCK + UNIT_POS as usize * ITEMS;
        let mut own = 0u32;
        for i in first..first + ITEMS {
            if i < count as usize {
                own += values[i];
            }
        }
        let (_, total) = scan_units(own, &mut room);
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
    let mut room = Shared::<[u32]>::new_slice(SCAN_ROOM);
    if CUBE_POS < blocks as usize {
        let first = CUBE_POS * SCAN_BLOCK + UNIT_POS as usize * ITEMS;
        let mut own = 0u32;
        for i in first..first + ITEMS {
            if i < count as usize {
                own += values[i];
            }
        }
        let (offset, _) = scan_units(own, &mut room);
        let mut running = offset;
        if !one {
            running += before[CUBE_POS];
        }
        for i in first..first + ITEMS {
            if i < count as usize {
                sums[i] = running;
                running += values[i];
                if i + 1 == count as usize {
                    total[0] = running;
                }
            }
        }
    }
}

/// The sum over the units before this one, and over all units. Every unit of the cube has to come here.
#[cube]
pub fn scan_units(value: u32, room: &mut Shared<[u32]>) -> (u32, u32) {
    let unit = UNIT_POS as usize;
    room[unit] = value;
    sync_cube();
    if unit < GROUP {
        let mut sum = 0u32;
        for i in unit * GROUP..(unit + 1) * GROUP {
            let next = room[i];
            room[i] = sum;
            sum += next;
        }
        room[UNITS + unit] = sum;
    }
    sync_cube();
    if unit == 0 {
        let mut sum = 0u32;
        for i in UNITS..UNITS + GROUP {
            let next = room[i];
            room[i] = sum;
            sum += next;
        }
        room[UNITS + GROUP] = sum;
    }
    sync_cube();
    let before = room[unit] + room[UNITS + unit / GROUP];
    let total = room[UNITS + GROUP];
    // The room may be used again.
    sync_cube();
    (before, total)
}
