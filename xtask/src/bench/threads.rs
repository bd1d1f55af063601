//! Numbers of threads to compare, each with a pool of its own.

use std::num::NonZeroUsize;

use anyhow::{Context, Result};
use rayon::ThreadPool;

/// The numbers without repetitions, ascending: first those that the cores can serve, then the others.
pub fn by_cores(asked: &[NonZeroUsize], cores: usize) -> [Vec<usize>; 2] {
    let mut counts: Vec<usize> = asked.iter().map(|count| count.get()).collect();
    counts.sort_unstable();
    counts.dedup();
    let (served, others) = counts.into_iter().partition(|&count| count <= cores);
    [served, others]
}

/// A pool for each number of threads, all cores by default. Numbers beyond the cores are left out: their threads would
/// only wait for each other.
pub fn pools(asked: &[NonZeroUsize]) -> Result<Vec<ThreadPool>> {
    let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    let [mut served, others] = by_cores(asked, cores);
    for count in others {
        eprintln!("note: {count} threads are left out, because there are {cores} cores");
    }
    if served.is_empty() {
        served.push(cores);
    }
    let pool = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build();
        pool.with_context(|| format!("cannot start {count} threads"))
    };
    served.into_iter().map(pool).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_sorted_and_those_beyond_the_cores_set_apart() {
        let asked: Vec<NonZeroUsize> = [8, 1, 2, 2, 4].into_iter().filter_map(NonZeroUsize::new).collect();
        assert_eq!(by_cores(&asked, 4), [vec![1, 2, 4], vec![8]]);
        assert_eq!(by_cores(&[], 4), [Vec::<usize>::new(), Vec::new()]);
    }

    #[test]
    fn a_pool_has_the_threads_that_were_asked_for() {
        let pools = pools(&[NonZeroUsize::MIN]).expect("one thread can be started");
        assert_eq!(pools.iter().map(ThreadPool::current_num_threads).collect::<Vec<_>>(), [1]);
        assert_eq!(pools[0].install(rayon::current_num_threads), 1);
    }
}
