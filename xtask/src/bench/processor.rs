//! Processor time of this process.

use std::fs;

/// Seconds for which the living threads of this process have run so far; known on Linux only.
///
/// The scheduler counts them in nanoseconds for each thread. The clock of the whole process has ticks of 10 ms, which
/// is as long as a step.
pub fn seconds() -> Option<f64> {
    let threads = fs::read_dir("/proc/self/task").ok()?;
    let of_thread = |thread: fs::DirEntry| {
        let times = fs::read_to_string(thread.path().join("schedstat")).ok()?;
        times.split_whitespace().next()?.parse::<u64>().ok()
    };
    // A thread may end between the listing and the look.
    let nanoseconds: Vec<u64> = threads.flatten().filter_map(of_thread).collect();
    (!nanoseconds.is_empty()).then(|| 1e-9 * nanoseconds.iter().sum::<u64>() as f64)
}

/// The share of the time of `threads` cores in which they did nothing: 0 to 1.
pub fn idle_share(wall: f64, processor: f64, threads: usize) -> f64 {
    (1.0 - processor / (wall * threads as f64)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn work_takes_processor_time_and_sleep_does_not() {
        let before = seconds().expect("Linux tells");
        let mut sum = 0u64;
        while seconds().expect("Linux tells") < before + 0.02 {
            sum = std::hint::black_box(sum + 1);
        }
        assert!(sum > 0);
    }

    #[test]
    fn cores_that_work_all_the_time_are_never_idle() {
        assert_eq!((idle_share(2.0, 8.0, 4), idle_share(2.0, 2.0, 4), idle_share(1.0, 1.1, 1)), (0.0, 0.75, 0.0));
    }
}
