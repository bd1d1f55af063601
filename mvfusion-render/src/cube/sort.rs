//! The radix sort on the device.

use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::sort::{DIGIT_BITS, DIGITS, MoveKind, SORT_BLOCK, count_digits, move_keys};

use super::gpu::{CUBE, Flat, Gpu};
use super::scan::running_sums;

/// Keys, each with a number.
pub(super) struct Keyed {
    pub keys: CubeTensor,
    pub numbers: CubeTensor,
}

/// Sorts by the lowest `bits > 0` bits of the keys; equal keys keep their order. Without `numbers`, a key's number is its
/// index. The buffers have room for `capacity > 0` keys, of which the first `total` `[1]` are valid.
pub(super) fn sort(
    gpu: &Gpu,
    keys: CubeTensor,
    numbers: Option<CubeTensor>,
    total: &CubeTensor,
    capacity: usize,
    bits: usize,
) -> Keyed {
    let blocks = capacity.div_ceil(SORT_BLOCK);
    let counts = gpu.naturals(DIGITS * blocks);
    let (mut keys, mut numbers) = (keys, numbers);
    let (mut moved_keys, mut spare) = (gpu.naturals(capacity), None);
    for shift in (0..bits).step_by(DIGIT_BITS) {
        // SAFETY: keys are read below `total`, which is at most the capacity; counts have an entry for each digit and
        // block.
        unsafe {
            count_digits::launch_unchecked(
                &gpu.client,
                gpu.cubes(blocks),
                CUBE,
                keys.clone().flat(),
                total.clone().flat(),
                counts.clone().flat(),
                shift as u32,
                blocks as u32,
            );
        }
        let offsets = running_sums(gpu, &counts, DIGITS * blocks).before;
        let kind = MoveKind { staged: gpu.stages_keys(), numbered: numbers.is_some() };
        let moved_numbers = spare.take().unwrap_or_else(|| gpu.naturals(capacity));
        // SAFETY: as above; a position is the number of preceding keys, so it is less than the number of keys.
        unsafe {
            move_keys::launch_unchecked(
                &gpu.client,
                gpu.cubes(blocks),
                CUBE,
                keys.clone().flat(),
                // Not read without numbers.
                numbers.as_ref().unwrap_or(&keys).clone().flat(),
                total.clone().flat(),
                offsets.flat(),
                moved_keys.clone().flat(),
                moved_numbers.clone().flat(),
                shift as u32,
                blocks as u32,
                kind,
            );
        }
        std::mem::swap(&mut keys, &mut moved_keys);
        spare = numbers.replace(moved_numbers);
    }
    // Proof: there is a pass, because there are bits.
    Keyed { keys, numbers: numbers.expect("a pass gives numbers") }
}

/// Bits needed for the numbers below `count`.
pub(super) fn bits_of(count: usize) -> usize {
    (usize::BITS - (count - 1).leading_zeros()) as usize
}
