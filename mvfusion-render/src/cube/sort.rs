//! The radix sort on the device.

use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::sort::{DIGIT_BITS, DIGITS, SORT_BLOCK, count_digits, move_keys};

use super::gpu::{CUBE, Flat, Gpu};
use super::scan::running_sums;

/// Keys, each with a number.
pub(super) struct Keyed {
    pub keys: CubeTensor,
    pub numbers: CubeTensor,
}

/// Sorts by the lowest `bits` bits of the keys; equal keys keep their order. The buffers have room for `capacity > 0`
/// keys, of which the first `total` `[1]` are valid.
pub(super) fn sort(gpu: &Gpu, mut sorted: Keyed, total: &CubeTensor, capacity: usize, bits: usize) -> Keyed {
    let blocks = capacity.div_ceil(SORT_BLOCK);
    let counts = gpu.naturals(DIGITS * blocks);
    let mut moved = Keyed { keys: gpu.naturals(capacity), numbers: gpu.naturals(capacity) };
    for shift in (0..bits).step_by(DIGIT_BITS) {
        // SAFETY: keys are read below `total`, which is at most the capacity; counts have an entry for each digit and
        // block.
        unsafe {
            count_digits::launch_unchecked(
                &gpu.client,
                gpu.cubes(blocks),
                CUBE,
                sorted.keys.clone().flat(),
                total.clone().flat(),
                counts.clone().flat(),
                shift as u32,
                blocks as u32,
            );
        }
        let offsets = running_sums(gpu, &counts, DIGITS * blocks).before;
        // SAFETY: as above; a position is the number of preceding keys, so it is less than the number of keys.
        unsafe {
            move_keys::launch_unchecked(
                &gpu.client,
                gpu.cubes(blocks),
                CUBE,
                sorted.keys.clone().flat(),
                sorted.numbers.clone().flat(),
                total.clone().flat(),
                offsets.flat(),
                moved.keys.clone().flat(),
                moved.numbers.clone().flat(),
                shift as u32,
                blocks as u32,
            );
        }
        std::mem::swap(&mut sorted, &mut moved);
    }
    sorted
}

/// Bits needed for the numbers below `count`.
pub(super) fn bits_of(count: usize) -> usize {
    (usize::BITS - (count - 1).leading_zeros()) as usize
}
