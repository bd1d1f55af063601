//! Decoded pictures within a budget of bytes, decoded ahead of their use by threads in the background.
//!
//! Training shows every picture once a round, in an order that is known a little ahead. A picture that was shown will
//! not be wanted before the next round, so what has to go is what was used last: an older one is wanted sooner. That
//! way a budget for k of n pictures saves k of n decodings a round; to keep those that were used last would save none.

#[cfg(test)]
mod tests;

use std::collections::{HashSet, VecDeque};
use std::panic::AssertUnwindSafe;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use image::{GrayImage, RgbImage};

use crate::{DataError, Mask, Picture, View};

/// Pictures and their masks by number, decoded or not.
#[derive(Debug)]
pub struct PictureCache {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

/// A picture with its mask, decoded.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// The picture.
    pub rgb: Arc<RgbImage>,
    /// 255 where its pixels count, 0 where they are to be ignored; all count where there is none.
    pub counted: Option<Arc<GrayImage>>,
}

/// A picture with its mask, to be decoded.
#[derive(Debug)]
struct Masked {
    picture: Picture,
    mask: Option<Mask>,
}

impl Masked {
    fn decode(&self) -> Result<Decoded, DataError> {
        let counted = self.mask.as_ref().map(Mask::read).transpose()?;
        Ok(Decoded { rgb: self.picture.rgb()?, counted: counted.map(Arc::new) })
    }

    /// Whether there is nothing to decode.
    fn is_ready(&self) -> bool {
        matches!(self.picture, Picture::Memory(_)) && self.mask.is_none()
    }

    /// Bytes when decoded, beyond what is in memory anyway.
    fn bytes(&self) -> u64 {
        let (width, height) = self.picture.size();
        let planes = match self.picture {
            Picture::Memory(_) => 0,
            Picture::File(_) => 3,
        };
        (planes + u64::from(self.mask.is_some())) * u64::from(width) * u64::from(height)
    }
}

#[derive(Debug)]
struct Shared {
    pictures: Vec<Masked>,
    budget: u64,
    state: Mutex<State>,
    /// Told when there is something to decode, room to decode into, or the end.
    work: Condvar,
    /// Told when a picture was decoded, or failed to.
    done: Condvar,
}

#[derive(Debug)]
struct State {
    entries: Vec<Entry>,
    /// What is to be decoded, the next first.
    queue: VecDeque<usize>,
    /// What a caller waits for.
    wanted: Vec<usize>,
    /// Bytes of what is decoded or being decoded.
    held: u64,
    /// Number of the next use.
    clock: u64,
    waited: Duration,
    ended: bool,
}

#[derive(Clone, Debug)]
enum Entry {
    Absent,
    Decoding,
    Ready {
        image: Decoded,
        /// Number of its last use; absent if it was not used since it was decoded.
        used: Option<u64>,
    },
    Failed,
}

impl PictureCache {
    /// A cache of the pictures of views that holds at most `budget` bytes of them decoded (but always the one that is
    /// asked for), with so many decoding threads. Pictures in memory count for nothing.
    pub fn new(views: &[View], budget: u64, threads: usize) -> Self {
        let masked = |view: &View| Masked { picture: view.image.clone(), mask: view.mask.clone() };
        let state = State {
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
            budget,
            state: Mutex::new(state),
            work: Condvar::new(),
            done: Condvar::new(),
        });
        let worker = |_| {
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || shared.decode_in_turn())
        };
        let workers = (0..threads.max(1)).map(worker).collect();
        Self { shared, workers }
    }

    /// Decodes all pictures if they fit into the budget, so that what cannot be read is found now.
    ///
    /// # Errors
    /// [`DataError::Image`] if one cannot be read.
    pub fn fill(&self) -> Result<(), DataError> {
        let bytes: u64 = self.shared.pictures.iter().map(Masked::bytes).sum();
        if bytes > self.shared.budget {
            return Ok(());
        }
        self.announce(&(0..self.len()).collect::<Vec<_>>());
        (0..self.len()).try_for_each(|index| self.get(index).map(drop))
    }

    /// Number of pictures.
    pub fn len(&self) -> usize {
        self.shared.pictures.len()
    }

    /// Whether there is no picture.
    pub fn is_empty(&self) -> bool {
        self.shared.pictures.is_empty()
    }

    /// Says which pictures will be asked for, in this order. What was announced before and is not among them is not
    /// decoded any more.
    pub fn announce(&self, upcoming: &[usize]) {
        let mut state = self.shared.lock();
        let mut seen = HashSet::new();
        let mut is_due = |index: &usize| self.shared.is_absent(&state, *index) && seen.insert(*index);
        let queue = state.wanted.iter().chain(upcoming).copied().filter(&mut is_due).collect();
        state.queue = queue;
        drop(state);
        self.shared.work.notify_all();
    }

    /// The picture of a number. Waits until it is decoded.
    ///
    /// # Errors
    /// [`DataError::Image`] if it cannot be read.
    pub fn get(&self, index: usize) -> Result<Decoded, DataError> {
        if self.shared.pictures[index].is_ready() {
            return self.shared.pictures[index].decode();
        }
        let mut state = self.shared.lock();
        if let Some(image) = state.take(index) {
            drop(state);
            // What was used may make room.
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
        // Tried again, to tell what is wrong: an error cannot be kept for several callers.
        image.map_or_else(|| self.shared.pictures[index].decode(), Ok)
    }

    /// How long callers have waited for pictures so far.
    pub fn waited(&self) -> Duration {
        self.shared.lock().waited
    }

    /// Bytes of the decoded pictures that are held now.
    pub fn held(&self) -> u64 {
        self.shared.lock().held
    }
}

impl Drop for PictureCache {
    fn drop(&mut self) {
        self.shared.lock().ended = true;
        self.shared.work.notify_all();
        for worker in self.workers.drain(..) {
            // A worker that panicked has said so; there is nothing left to lose here.
            let _ = worker.join();
        }
    }
}

impl State {
    /// The picture, if it is decoded; counts as a use.
    fn take(&mut self, index: usize) -> Option<Decoded> {
        let Entry::Ready { image, used } = &mut self.entries[index] else { return None };
        *used = Some(self.clock);
        self.clock += 1;
        Some(image.clone())
    }

    /// What had best go: what was used last; if somebody waits for room, what was not used yet as well.
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
    /// A worker that panicked left no entry half written.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_absent(&self, state: &State, index: usize) -> bool {
        !self.pictures[index].is_ready() && matches!(state.entries[index], Entry::Absent)
    }

    fn bytes(&self, index: usize) -> u64 {
        self.pictures[index].bytes()
    }

    fn decode_in_turn(&self) {
        let mut state = self.lock();
        while !state.ended {
            let Some(index) = self.next(&mut state) else {
                state = self.work.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            drop(state);
            // A decoder that panics would leave its callers waiting; whoever wants the picture meets the panic itself.
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

    /// Takes the next picture to decode out of the queue and makes room for it; `None` if there is none, or no room
    /// before something is used.
    fn next(&self, state: &mut State) -> Option<usize> {
        let &index = state.queue.front()?;
        let (bytes, urgent) = (self.bytes(index), state.wanted.contains(&index));
        while state.held > 0 && state.held + bytes > self.budget {
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
