//! A cache of decoded images with a byte budget. Background threads decode ahead of use.
//!
//! Training shows every image once per round, in an order that is known slightly ahead. The most recently shown image
//! is needed last, so it is evicted first. With this rule, a budget for k of n images saves k of n decodings per round.
//! Keeping the most recent images instead would save none.

mod masked;
mod shared;
#[cfg(test)]
mod tests;

use std::collections::{HashSet, VecDeque};
use std::io;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

pub use masked::Decoded;
use tracing::warn;

use super::view::View;
use crate::error::DataError;
use masked::Masked;
use shared::{Entry, Shared, State};

/// Images and their masks by index, decoded or not.
#[derive(Debug)]
pub struct PictureCache {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

impl PictureCache {
    /// A cache of the images of `views`, with this many decoding threads, or as many of them as the system starts. It
    /// keeps at most `budget` bytes of decoded images, but always the requested one. Images in memory count as zero
    /// bytes.
    pub fn new(views: &[View], budget: u64, threads: usize) -> Self {
        Self::with_threads(views, budget, threads, |shared| {
            std::thread::Builder::new().name("pictures".to_owned()).spawn(move || shared.decode_in_turn())
        })
    }

    /// The same with threads that `start` starts.
    fn with_threads(
        views: &[View],
        budget: u64,
        threads: usize,
        start: impl Fn(Arc<Shared>) -> io::Result<JoinHandle<()>>,
    ) -> Self {
        let masked = |view: &View| Masked { picture: view.image.clone(), mask: view.mask.clone() };
        let state = State {
            budget,
            entries: vec![Entry::Absent; views.len()],
            queue: VecDeque::new(),
            wanted: Vec::new(),
            held: 0,
            clock: 0,
            waited: Duration::ZERO,
            ended: false,
        };
        let shared = Arc::new(Shared {
            pictures: views.iter().map(masked).collect(),
            state: Mutex::new(state),
            work: Condvar::new(),
            done: Condvar::new(),
        });
        let mut workers = Vec::new();
        for started in 0..threads.max(1) {
            match start(Arc::clone(&shared)) {
                Ok(worker) => workers.push(worker),
                Err(error) => {
                    warn!("only {started} of {threads} threads that decode images could be started: {error}");
                    break;
                }
            }
        }
        Self { shared, workers }
    }

    /// Changes the budget, in bytes. Images that no longer fit are evicted when the next one is decoded.
    pub fn set_budget(&self, budget: u64) {
        self.shared.lock().budget = budget;
        self.shared.work.notify_all();
    }

    /// Decodes all images if they fit into the budget, so that unreadable files are found now.
    ///
    /// # Errors
    /// [`DataError::Image`] if one cannot be read.
    pub fn fill(&self) -> Result<(), DataError> {
        let bytes: u64 = self.shared.pictures.iter().map(Masked::bytes).sum();
        if bytes > self.shared.lock().budget {
            return Ok(());
        }
        self.announce(&(0..self.len()).collect::<Vec<_>>());
        (0..self.len()).try_for_each(|index| self.get(index).map(drop))
    }

    /// Number of images.
    pub fn len(&self) -> usize {
        self.shared.pictures.len()
    }

    /// Whether there is no image.
    pub fn is_empty(&self) -> bool {
        self.shared.pictures.is_empty()
    }

    /// Announces the next requests, in this order. Images of an earlier announcement that are not among them are no
    /// longer decoded.
    pub fn announce(&self, upcoming: &[usize]) {
        let mut state = self.shared.lock();
        let mut seen = HashSet::new();
        let mut is_due = |index: &usize| self.shared.is_absent(&state, *index) && seen.insert(*index);
        let queue = state.wanted.iter().chain(upcoming).copied().filter(&mut is_due).collect();
        state.queue = queue;
        drop(state);
        self.shared.work.notify_all();
    }

    /// The image at an index. Waits until it is decoded.
    ///
    /// # Errors
    /// [`DataError::Image`] if it cannot be read.
    pub fn get(&self, index: usize) -> Result<Decoded, DataError> {
        // Without threads, nobody else decodes.
        if self.shared.pictures[index].is_ready() || self.workers.is_empty() {
            return self.shared.pictures[index].decode();
        }
        let mut state = self.shared.lock();
        if let Some(image) = state.take(index) {
            drop(state);
            // A used image may be evicted to make room.
            self.shared.work.notify_all();
            return Ok(image);
        }
        let started = Instant::now();
        state.wanted.push(index);
        let image = loop {
            match state.entries[index] {
                Entry::Ready { .. } => break state.take(index),
                Entry::Failed => break None,
                Entry::Decoding => {}
                Entry::Absent => {
                    state.queue.retain(|&other| other != index);
                    state.queue.push_front(index);
                    self.shared.work.notify_all();
                }
            }
            state = self.shared.done.wait(state).unwrap_or_else(PoisonError::into_inner);
        };
        state.waited += started.elapsed();
        if let Some(place) = state.wanted.iter().position(|&other| other == index) {
            state.wanted.swap_remove(place);
        }
        drop(state);
        self.shared.work.notify_all();
        // Decoded again to get the error, because an error cannot be stored for several callers.
        image.map_or_else(|| self.shared.pictures[index].decode(), Ok)
    }

    /// Total time that callers have waited for images.
    pub fn waited(&self) -> Duration {
        self.shared.lock().waited
    }

    /// Bytes of decoded images in the cache.
    pub fn held(&self) -> u64 {
        self.shared.lock().held
    }
}

impl Drop for PictureCache {
    fn drop(&mut self) {
        self.shared.lock().ended = true;
        self.shared.work.notify_all();
        for worker in self.workers.drain(..) {
            // A panicked worker has already reported its panic.
            let _ = worker.join();
        }
    }
}
