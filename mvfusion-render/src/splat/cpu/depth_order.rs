//! The visible Gaussians in blending order.

use mvfusion_kernels::splat::{PROJECTED_LEN, Projected};
use rayon::prelude::*;

use super::lanes::Lane;
use super::project::Projections;

/// Minimum number of Gaussians that a task looks at.
const MIN_GAUSSIANS_PER_TASK: usize = 4096;
/// Bits of a digit of the radix sort: three digits hold a key, and the counts of a digit fit into the fastest cache.
const DIGIT_BITS: u32 = 11;
/// Number of digits of a key.
const DIGITS: usize = u32::BITS.div_ceil(DIGIT_BITS) as usize;

/// A Gaussian with its sort key.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Keyed {
    key: u32,
    id: u32,
}

impl Keyed {
    /// A digit of the key; digit 0 is the least significant one.
    #[inline(always)]
    fn digit(self, digit: usize) -> usize {
        (self.key >> (digit as u32 * DIGIT_BITS)) as usize % (1 << DIGIT_BITS)
    }
}

/// Potentially visible Gaussians, by depth, ties by index.
pub(super) fn depth_order<T: Lane>(projections: &Projections<T>) -> Vec<u32> {
    let (records, radii) = (projections.records.as_chunks::<PROJECTED_LEN>().0, projections.radii.as_chunks::<2>().0);
    let key = |id: usize, word: usize| {
        let key = Projected::from_row(&records[id]).depth.order_key();
        (key >> (word * u32::BITS as usize)) as u32
    };
    let seen = |id: usize| radii[id][0] > 0 && Projected::from_row(&records[id]).reach > T::zero();
    let mut order: Vec<Keyed> = (0..records.len())
        .into_par_iter()
        .with_min_len(MIN_GAUSSIANS_PER_TASK)
        .filter_map(|id| seen(id).then(|| Keyed { key: key(id, 0), id: id as u32 }))
        .collect();
    sort(&mut order);
    // A key in double precision has another word. The sort keeps the order of the first where the second is equal.
    for word in 1..size_of::<T>() / size_of::<u32>() {
        order.iter_mut().for_each(|entry| entry.key = key(entry.id as usize, word));
        sort(&mut order);
    }
    order.into_iter().map(|entry| entry.id).collect()
}

/// Sorts by the key. Equal keys keep their order.
fn sort(entries: &mut Vec<Keyed>) {
    let mut counts = [[0u32; 1 << DIGIT_BITS]; DIGITS];
    for entry in entries.iter() {
        for (digit, counts) in counts.iter_mut().enumerate() {
            counts[entry.digit(digit)] += 1;
        }
    }
    let mut sorted = vec![Keyed::default(); entries.len()];
    for (digit, counts) in counts.iter_mut().enumerate() {
        // Depths are alike, so their first digits often are the same.
        if entries.first().is_none_or(|first| counts[first.digit(digit)] as usize == entries.len()) {
            continue;
        }
        let mut next = 0;
        for count in counts.iter_mut() {
            next += std::mem::replace(count, next);
        }
        for &entry in entries.iter() {
            let place = &mut counts[entry.digit(digit)];
            sorted[*place as usize] = entry;
            *place += 1;
        }
        std::mem::swap(entries, &mut sorted);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::random;

    #[test]
    fn the_sort_is_that_of_the_standard_library() {
        for (len, spread) in [(0, 1.0), (1, 1.0), (2, 1.0), (3000, 5.0), (3000, 4e9)] {
            let numbers = random(3, len).into_iter().zip(0..);
            let mut entries: Vec<Keyed> = numbers.map(|(u, id)| Keyed { key: (u * spread) as u32, id }).collect();
            let mut wanted = entries.clone();
            wanted.sort_by_key(|entry| entry.key);
            sort(&mut entries);
            assert!(entries == wanted, "{len} keys below {spread}");
        }
    }

    #[test]
    fn gaussians_are_ordered_by_depth_then_by_index_in_both_precisions() {
        fn order_of<T: Lane>(depths: &[f64]) -> Vec<u32> {
            let row =
                |&depth: &f64| Projected { depth: T::of(depth), reach: T::one(), ..Projected::default() }.to_row();
            let records = depths.iter().flat_map(row).collect();
            depth_order(&Projections { records, radii: vec![1; 2 * depths.len()] })
        }
        // Multiples of 1/512 are the same numbers in both precisions.
        let depths: Vec<f64> = random(4, 2000).into_iter().map(|u| (u * 4000.0).floor() / 512.0 + 0.5).collect();
        let mut wanted: Vec<u32> = (0..2000).collect();
        wanted.sort_by(|&a, &b| depths[a as usize].total_cmp(&depths[b as usize]));
        assert_eq!(order_of::<f32>(&depths), wanted);
        assert_eq!(order_of::<f64>(&depths), wanted);
        let close = [1.0 + 2e-16, 1.0, 1.0 + 4e-16, 1e-3];
        assert_eq!(order_of::<f64>(&close), [3, 1, 0, 2]);
    }

    #[test]
    fn gaussians_without_a_radius_or_reach_are_left_out() {
        let row = |reach: f32| Projected { depth: 1.0, reach, ..Projected::default() }.to_row();
        let records = [1.0, 1.0, 0.0, f32::NEG_INFINITY, 1.0].into_iter().flat_map(row).collect();
        assert_eq!(depth_order(&Projections { records, radii: vec![1, 1, 0, 0, 1, 1, 1, 1, 1, 1] }), [0, 4]);
    }
}
