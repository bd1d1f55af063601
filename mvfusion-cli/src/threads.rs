//! The number of CPU threads.

use std::num::NonZeroUsize;

use anyhow::Context;

/// Most threads per core. More of them only wait for each other, and each has its memory.
const MOST_PER_CORE: usize = 4;

/// Threads that are granted on any machine, so that a run can be repeated with the same number.
const ALWAYS: usize = 16;

/// The number of threads to use: what was asked for, but at most [`most`]; otherwise all cores.
pub fn count(asked: Option<NonZeroUsize>) -> usize {
    asked.map_or_else(cores, |asked| asked.get().min(most()))
}

/// The largest number of threads on this machine.
pub fn most() -> usize {
    cores().saturating_mul(MOST_PER_CORE).max(ALWAYS)
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, NonZeroUsize::get)
}

/// Starts the process-wide pool with so many threads. The calling thread is one of them: it works while it waits, instead
/// of going to sleep a hundred times a step. Other threads must therefore not wait for the pool while the calling thread
/// waits for them.
///
/// # Errors
/// If the pool was started before, or the system refuses the threads.
pub fn start(threads: usize) -> anyhow::Result<()> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .use_current_thread()
        .build_global()
        .with_context(|| format!("cannot start {threads} threads; give a smaller --threads"))
}

/// A pool of so many threads for the calling thread alone, which is one of them, until the pool is dropped. For programs
/// that compute in several threads of their own.
///
/// # Errors
/// If the calling thread is in a pool already, or the system refuses the threads.
pub fn start_own(threads: usize) -> anyhow::Result<rayon::ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .use_current_thread()
        .build()
        .with_context(|| format!("cannot start {threads} threads; use fewer"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pool_of_ones_own_has_the_threads_that_were_asked_for_and_ends_with_its_thread() {
        let inside = std::thread::spawn(|| {
            let _pool = start_own(3).expect("started");
            assert!(start_own(2).is_err(), "a thread is in one pool");
            (rayon::current_num_threads(), rayon::current_thread_index())
        });
        assert_eq!(inside.join().expect("no panic"), (3, Some(0)));
        assert_eq!(rayon::current_thread_index(), None);
    }

    #[test]
    fn no_more_threads_are_used_than_the_cores_can_serve() {
        let asked = |threads| count(NonZeroUsize::new(threads));
        assert_eq!((asked(1), asked(ALWAYS)), (1, ALWAYS));
        assert_eq!((asked(usize::MAX), count(None)), (most(), cores()));
    }
}
