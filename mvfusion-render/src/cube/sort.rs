//! The radix sort on the device.

use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::sort::{DIGIT_BITS, DIGITS, SORT_BLOCK, count_digits, move_keys};

use super::gpu::{CUBE, Gpu};
use super::scan::running_sums;

/// Keys, and a number that goes with each.
pub(super) struct Keyed {
    pub keys: CubeTensor,
    pub numbers: CubeTensor,
}

/// Sorts by the lowest `bits` bits of the keys; equal keys keep their order. There is room for `capacity > 0` keys, and
/// `total` `[1]` of them are there.
pub(super) fn sort(gpu: &Gpu, mut sorted: Keyed, total: &CubeTensor, capacity: usize, bits: usize) -> Keyed {
    let blocks = capacity.div_ceil(SORT_BLOCK);
    let counts = gpu.naturals(DIGITS * blocks);
    let mut moved = Keyed { keys: gpu.naturals(capacity), numbers: gpu.naturals(capacity) };
    for shift in (0..bits).step_by(DIGIT_BITS) {
        // SAFETY: keys are read below `total`, which is at most the capacity; counts have a place for each digit and
        // block.
        unsafe {
            count_digits::launch_unchecked(
                &gpu.client,
                gpu.cubes(blocks),
                CUBE,
                sorted.keys.clone().into_buffer_arg(),
                total.clone().into_buffer_arg(),
                counts.clone().into_buffer_arg(),
                shift as u32,
                blocks as u32,
            );
        }
        let offsets = running_sums(gpu, &counts, DIGITS * blocks).before;
        // SAFETY: as before; a place is the number of keys that come first, so it lies below their number.
        unsafe {
            move_keys::launch_unchecked(
                &gpu.client,
                gpu.cubes(blocks),
                CUBE,
                sorted.keys.clone().into_buffer_arg(),
                sorted.numbers.clone().into_buffer_arg(),
                total.clone().into_buffer_arg(),
                offsets.into_buffer_arg(),
                moved.keys.clone().into_buffer_arg(),
                moved.numbers.clone().into_buffer_arg(),
                shift as u32,
                blocks as u32,
            );
        }
        std::mem::swap(&mut sorted, &mut moved);
    }
    sorted
}
