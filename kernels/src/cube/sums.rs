//! Sums over the rows of a matrix. No CPU twin: CPUs add where the rows are made.

use cubecl::prelude::*;

use super::UNITS;

/// Rows that a unit adds at least, unless there are fewer.
const ITEMS: usize = 16;

/// Largest number of partial sums of a column, except where there are very many rows.
const MOST_SLABS: usize = 1024;

/// Most columns of a cube. More would leave fewer units for the rows.
const MOST_ACROSS: usize = 64;

/// How a sum over rows is divided among cubes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SumPlan {
    /// Columns of a cube: a power of two.
    pub across: usize,
    /// Rows of a cube.
    pub slab: usize,
    /// Slabs, each with a row of partial sums.
    pub slabs: usize,
    /// Cubes of the launch.
    pub cubes: usize,
}

impl SumPlan {
    /// The plan for a matrix `[rows, columns]`.
    pub fn new(rows: usize, columns: usize) -> Self {
        let across = columns.next_power_of_two().clamp(1, MOST_ACROSS);
        let slab = (ITEMS * UNITS / across).max(rows.div_ceil(MOST_SLABS));
        let slabs = rows.div_ceil(slab).max(1);
        Self { across, slab, slabs, cubes: slabs * columns.div_ceil(across) }
    }
}

/// The sums of each slab's rows, `[slabs, columns]`, of `values` `[rows, columns]`. A unit adds every few rows of a
/// column, and a cube adds its units in a fixed order, so that the result is the same each time.
#[cube(launch_unchecked)]
pub fn sum_rows(
    values: &[f32],
    sums: &mut [f32],
    rows: u32,
    columns: u32,
    slab: u32,
    cubes: u32,
    #[comptime] across: usize,
) {
    let mut scratch = Shared::<[f32]>::new_slice(UNITS);
    if CUBE_POS < cubes as usize {
        let (unit, cube) = (UNIT_POS as usize, CUBE_POS as u32);
        let blocks = (columns + comptime!(across as u32 - 1)) / comptime!(across as u32);
        let column = cube % blocks * comptime!(across as u32) + (unit % across) as u32;
        let number = cube / blocks;
        let end = min((number + 1u32) * slab, rows);
        let mut row = number * slab + (unit / across) as u32;
        let mut sum = 0.0f32;
        if column < columns {
            while row < end {
                sum += values[row as usize * columns as usize + column as usize];
                row += comptime!((UNITS / across) as u32);
            }
        }
        scratch[unit] = sum;
        sync_cube();
        let mut half = comptime!(UNITS / 2).runtime();
        while half >= across {
            if unit < half {
                scratch[unit] += scratch[unit + half];
            }
            sync_cube();
            half /= 2;
        }
        if unit < across && column < columns {
            sums[number as usize * columns as usize + column as usize] = scratch[unit];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_hold_all_rows_and_become_fewer() {
        for rows in [0, 1, 1000, 4096, 5000, 300_000, 50_000_000] {
            for columns in [1, 2, 3, 64, 100, 150_000] {
                let plan = SumPlan::new(rows, columns);
                assert!(plan.slab * plan.slabs >= rows && (plan.slabs == 1 || plan.slabs < rows), "{plan:?}");
                assert!(plan.slabs <= MOST_SLABS && plan.across <= UNITS, "{plan:?}");
            }
        }
    }
}
