//! The state that the users of a cache and its decoding threads share.

use std::collections::VecDeque;
use std::panic::AssertUnwindSafe;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::masked::{Decoded, Masked};

/// The images and their state.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) pictures: Vec<Masked>,
    pub(super) state: Mutex<State>,
    /// Notified when there is something to decode, room to decode into, or the end.
    pub(super) work: Condvar,
    /// Notified when an image was decoded or failed to.
    pub(super) done: Condvar,
}

/// The decoded images, and the queue of images to decode.
#[derive(Debug)]
pub(super) struct State {
    /// Most bytes of decoded images, apart from a requested one.
    pub(super) budget: u64,
    pub(super) entries: Vec<Entry>,
    /// Images to decode, the next one first.
    pub(super) queue: VecDeque<usize>,
    /// Images that callers wait for.
    pub(super) wanted: Vec<usize>,
    /// Bytes of images that are decoded or being decoded.
    pub(super) held: u64,
    /// Counter of uses.
    pub(super) clock: u64,
    pub(super) waited: Duration,
    pub(super) ended: bool,
}

/// The state of an image.
#[derive(Clone, Debug)]
pub(super) enum Entry {
    Absent,
    Decoding,
    Ready {
        image: Decoded,
        /// The counter at its last use; `None` if it was not used since it was decoded.
        used: Option<u64>,
    },
    Failed,
}

impl State {
    /// The image if it is decoded. Counts as a use.
    pub(super) fn take(&mut self, index: usize) -> Option<Decoded> {
        let Entry::Ready { image, used } = &mut self.entries[index] else { return None };
        *used = Some(self.clock);
        self.clock += 1;
        Some(image.clone())
    }

    /// The image to evict: the most recently used one. If a caller waits for room, images that were not used yet may
    /// also be evicted.
    fn victim(&self, urgent: bool) -> Option<usize> {
        let last_use = |(index, entry): (usize, &Entry)| match entry {
            Entry::Ready { .. } if self.wanted.contains(&index) => None,
            Entry::Ready { used: None, .. } if !urgent => None,
            Entry::Ready { used, .. } => Some((*used, index)),
            _ => None,
        };
        self.entries.iter().enumerate().filter_map(last_use).max().map(|(_, index)| index)
    }
}

impl Shared {
    /// Locks the state. A panicked worker leaves no entry half written.
    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn is_absent(&self, state: &State, index: usize) -> bool {
        !self.pictures[index].is_ready() && matches!(state.entries[index], Entry::Absent)
    }

    fn bytes(&self, index: usize) -> u64 {
        self.pictures[index].bytes()
    }

    pub(super) fn decode_in_turn(&self) {
        let mut state = self.lock();
        while !state.ended {
            let Some(index) = self.next(&mut state) else {
                state = self.work.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            drop(state);
            // A panic in a decoder would leave its callers waiting. A caller that decodes the image itself gets the
            // panic.
            let image = std::panic::catch_unwind(AssertUnwindSafe(|| self.pictures[index].decode()));
            state = self.lock();
            state.entries[index] = match image {
                Ok(Ok(image)) => Entry::Ready { image, used: None },
                Ok(Err(_)) | Err(_) => {
                    state.held -= self.bytes(index);
                    Entry::Failed
                }
            };
            self.done.notify_all();
        }
    }

    /// Removes the next image from the queue and makes room for it. `None` if the queue is empty, or if there is no
    /// room until another image is used.
    fn next(&self, state: &mut State) -> Option<usize> {
        let &index = state.queue.front()?;
        let (bytes, urgent) = (self.bytes(index), state.wanted.contains(&index));
        while state.held > 0 && state.held + bytes > state.budget {
            let victim = state.victim(urgent)?;
            state.entries[victim] = Entry::Absent;
            state.held -= self.bytes(victim);
        }
        state.queue.pop_front();
        state.held += bytes;
        state.entries[index] = Entry::Decoding;
        Some(index)
    }
}
