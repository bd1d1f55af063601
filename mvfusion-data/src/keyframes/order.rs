//! An order in which neighbours in space are near each other.

/// Bits of a coordinate in a key.
const BITS: u32 = 21;

/// The places of `centres` along a Morton curve; ties keep their order.
pub(super) fn morton_order(centres: &[[i32; 3]]) -> Vec<usize> {
    let low = [0, 1, 2].map(|axis| centres.iter().map(|centre| centre[axis]).min().unwrap_or(0));
    let high = [0, 1, 2].map(|axis| centres.iter().map(|centre| centre[axis]).max().unwrap_or(0));
    let reach = (0..3).map(|axis| i64::from(high[axis]) - i64::from(low[axis])).max().unwrap_or(0);
    // The longest side fits into the bits of a coordinate.
    let shift = (i64::BITS - reach.leading_zeros()).saturating_sub(BITS);
    let key = |centre: &[i32; 3]| {
        let cell = |axis: usize| ((i64::from(centre[axis]) - i64::from(low[axis])) >> shift) as u64;
        spaced(cell(0)) | (spaced(cell(1)) << 1) | (spaced(cell(2)) << 2)
    };
    let mut places: Vec<usize> = (0..centres.len()).collect();
    places.sort_by_cached_key(|&place| key(&centres[place]));
    places
}

/// The bits of a number, two zeros before each.
fn spaced(number: u64) -> u64 {
    (0..BITS).map(|bit| ((number >> bit) & 1) << (3 * bit)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_eight_corners_of_a_cube_follow_each_other_before_the_next_cube() {
        let corner = |index: i32, side: i32| [index & 1, (index >> 1) & 1, index >> 2].map(|bit| bit * side - 100);
        let mut centres: Vec<[i32; 3]> = (0..8).map(|index| corner(index, 1)).collect();
        centres.extend((1..8).map(|index| corner(index, 1 << 28)));
        let near: Vec<usize> = morton_order(&centres).into_iter().take(8).collect();
        let mut sorted = near.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..8).collect::<Vec<_>>());
        assert_eq!(morton_order(&centres[..8]), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert!(morton_order(&[]).is_empty());
    }
}
