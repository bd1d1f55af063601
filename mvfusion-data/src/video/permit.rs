//! A limit for the number of videos that are decoded concurrently.
//!
//! Every thread that decodes images may start a different video. A video keeps several full-size frames while they are
//! resized and written. Without a limit, a rig of twenty cameras on a large machine would need tens of gigabytes.

use std::sync::{Condvar, Mutex, PoisonError};

/// Maximum number of videos decoded concurrently. Each keeps a few threads busy.
const MOST_VIDEOS: usize = 4;
/// Maximum number of frames of all videos that are resized and written concurrently.
const MOST_FRAMES: usize = 16;

static TAKEN: Mutex<usize> = Mutex::new(0);
static GIVEN_BACK: Condvar = Condvar::new();

/// Held while a video is decoded.
pub(super) struct Permit(());

impl Permit {
    /// Waits until fewer than [`MOST_VIDEOS`] permits are held.
    pub(super) fn take() -> Self {
        let taken = TAKEN.lock().unwrap_or_else(PoisonError::into_inner);
        let mut taken =
            GIVEN_BACK.wait_while(taken, |taken| *taken >= MOST_VIDEOS).unwrap_or_else(PoisonError::into_inner);
        *taken += 1;
        Self(())
    }

    /// Number of frames that one permit allows to be resized and written in parallel.
    pub(super) fn frames_at_once() -> usize {
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get().min(MOST_FRAMES));
        threads.div_ceil(MOST_VIDEOS)
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        *TAKEN.lock().unwrap_or_else(PoisonError::into_inner) -= 1;
        GIVEN_BACK.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    use super::*;

    #[test]
    fn no_more_permits_are_held_than_there_are_and_each_gets_one() {
        let (held, most, served) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..3 * MOST_VIDEOS {
                scope.spawn(|| {
                    let _permit = Permit::take();
                    most.fetch_max(held.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                    std::thread::sleep(Duration::from_millis(5));
                    held.fetch_sub(1, Ordering::SeqCst);
                    served.fetch_add(1, Ordering::SeqCst);
                });
            }
        });
        assert!(most.into_inner() <= MOST_VIDEOS);
        assert_eq!(served.into_inner(), 3 * MOST_VIDEOS);
        assert!(Permit::frames_at_once() * MOST_VIDEOS <= MOST_FRAMES);
    }
}
