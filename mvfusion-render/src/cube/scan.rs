//! Prefix sums on the device.

use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::scan::{SCAN_BLOCK, scan_blocks, sum_blocks};

use super::gpu::{CUBE, Flat, Gpu};

/// Prefix sums of `[count]` integers.
pub(super) struct RunningSums {
    /// The sum of the values before each one, `[count]`.
    pub before: CubeTensor,
    /// The sum of all values, `[1]`.
    pub total: CubeTensor,
}

/// The sum of `values`, with `count > 0` entries: `[1]`.
pub(super) fn total(gpu: &Gpu, values: &CubeTensor, count: usize) -> CubeTensor {
    let blocks = count.div_ceil(SCAN_BLOCK);
    let sums = block_sums(gpu, values, count, blocks);
    if blocks == 1 { sums } else { total(gpu, &sums, blocks) }
}

fn block_sums(gpu: &Gpu, values: &CubeTensor, count: usize, blocks: usize) -> CubeTensor {
    let sums = gpu.naturals(blocks);
    sum_blocks::launch(
        &gpu.client,
        gpu.cubes(blocks),
        CUBE,
        values.clone().flat(),
        sums.clone().flat(),
        count as u32,
        blocks as u32,
    );
    sums
}

/// The prefix sums of `values`, with `count > 0` entries.
pub(super) fn running_sums(gpu: &Gpu, values: &CubeTensor, count: usize) -> RunningSums {
    let blocks = count.div_ceil(SCAN_BLOCK);
    let offsets = if blocks == 1 {
        values.clone()
    } else {
        running_sums(gpu, &block_sums(gpu, values, count, blocks), blocks).before
    };
    let (before, total) = (gpu.naturals(count), gpu.naturals(1));
    scan_blocks::launch(
        &gpu.client,
        gpu.cubes(blocks),
        CUBE,
        values.clone().flat(),
        offsets.flat(),
        before.clone().flat(),
        total.clone().flat(),
        count as u32,
        blocks as u32,
        blocks == 1,
    );
    RunningSums { before, total }
}
