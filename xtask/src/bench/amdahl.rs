//! Amdahl's law: the part of the work that one thread does alone.

/// The share of one thread's time that no further thread shortens, from times (threads, seconds). `None` for fewer than
/// two numbers of threads.
///
/// `seconds = alone + shared / threads` is a line over `1 / threads`, fitted by least squares.
pub fn serial_share(times: &[(usize, f64)]) -> Option<f64> {
    let count = times.len() as f64;
    let points = times.iter().map(|&(threads, seconds)| (1.0 / threads as f64, seconds));
    let (x, y) = points.clone().fold((0.0, 0.0), |(x, y), point| (x + point.0 / count, y + point.1 / count));
    let spread: f64 = points.clone().map(|point| (point.0 - x).powi(2)).sum();
    if spread == 0.0 {
        return None;
    }
    let shared = points.map(|point| (point.0 - x) * (point.1 - y)).sum::<f64>() / spread;
    let alone = y - shared * x;
    Some((alone / (alone + shared)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of a fit to a few numbers around 1.
    const ROUNDING: f64 = 1e-12;

    #[test]
    fn an_exact_law_is_found_from_two_counts_and_from_many() {
        for share in [0.0, 0.12, 0.5, 1.0] {
            let time = |threads: usize| (threads, 0.7 * (share + (1.0 - share) / threads as f64));
            for counts in [vec![1, 2], vec![1, 2, 4, 8, 16], vec![3, 5]] {
                let times: Vec<_> = counts.into_iter().map(time).collect();
                let found = serial_share(&times).expect("several counts");
                assert!((found - share).abs() < ROUNDING, "{share}: {found}");
            }
        }
    }

    #[test]
    fn one_count_says_nothing() {
        assert_eq!(serial_share(&[]), None);
        assert_eq!(serial_share(&[(4, 1.0), (4, 2.0)]), None);
    }

    #[test]
    fn more_threads_that_take_longer_are_all_serial() {
        assert_eq!(serial_share(&[(1, 1.0), (2, 1.5)]), Some(1.0));
    }
}
