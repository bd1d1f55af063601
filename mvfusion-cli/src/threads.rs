//! The number of CPU threads.

use std::num::NonZeroUsize;

use anyhow::Context;

/// The number of threads to use: what was asked for, else all cores.
pub fn count(asked: Option<NonZeroUsize>) -> usize {
    asked.or_else(|| std::thread::available_parallelism().ok()).map_or(1, NonZeroUsize::get)
}

/// Starts the process-wide pool with so many threads.
///
/// # Errors
/// If the pool was started before, or the system refuses the threads.
pub fn start(threads: usize) -> anyhow::Result<()> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .with_context(|| format!("cannot start {threads} threads; give a smaller --threads"))
}
