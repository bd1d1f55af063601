//! Frames that are rendered together: their tile lists are made at once, and the host waits for the device once.

use std::fmt::{self, Debug, Formatter};
use std::sync::{Arc, Mutex, PoisonError};

use super::bins::{Bins, sort_by_tile};
use super::depth::sort_by_depth;
use super::frame::ProjectedFrame;
use super::gpu::most_sorted_together;
use super::scan::total;
use super::totals::Totals;
use crate::splat::SplatError;

/// The frames of a batch. All are added before the first list is asked for.
#[derive(Default)]
pub(crate) struct Batch {
    /// The lengths of their lists.
    totals: Totals,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    frames: Vec<Arc<ProjectedFrame>>,
    /// The lists of the frames that were sorted together, until they are taken. None before that.
    lists: Option<Vec<Option<Bins>>>,
}

impl Batch {
    /// Adds a frame with Gaussians. Returns its index.
    pub(super) fn add(&self, frame: Arc<ProjectedFrame>) -> usize {
        let total = total(&frame.frame.gpu, &frame.projected.touched, frame.frame.count());
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.frames.push(frame);
        self.totals.announce(&total)
    }

    /// Starts to read the lengths of the lists. What is launched later does not delay it.
    pub fn start(&self) {
        self.totals.start();
    }

    /// Takes the lists of a frame. Its largest buffer will have `pair_bytes` per pair of a Gaussian and a tile. The first
    /// call makes those of all frames. This is the only place where the host waits for the device.
    ///
    /// # Errors
    /// If the device cannot bind such a buffer, the number of pairs overflows an index, or the device fails.
    pub(super) fn take_lists(&self, index: usize, pair_bytes: u64) -> Result<Bins, SplatError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { frames, lists } = &mut *state;
        let lists = match lists {
            Some(lists) => lists,
            none => none.insert(self.sort_together(frames)?),
        };
        let own = &frames[index..=index];
        // What is missing is launched before the host waits.
        let ready = lists[index].take().ok_or_else(|| sort_by_depth(own));
        let pairs = self.totals.get(index)?;
        own[0].frame.check_lists(pairs, pair_bytes)?;
        // Proof: there is one list for one frame.
        Ok(ready.unwrap_or_else(|by_depth| sort_by_tile(own, by_depth, &[pairs as usize]).pop().expect("one")))
    }

    /// The lists of several frames; none for each if they are too many or too long. Beyond some length, a sort takes so
    /// long that its launches no longer matter, and its buffers take memory.
    fn sort_together(&self, frames: &[Arc<ProjectedFrame>]) -> Result<Vec<Option<Bins>>, SplatError> {
        let most = most_sorted_together();
        let apart = || frames.iter().map(|_| None).collect();
        if frames.len() == 1 || frames.iter().map(|frame| frame.frame.count()).sum::<usize>() > most {
            return Ok(apart());
        }
        let by_depth = sort_by_depth(frames);
        let lengths = (0..frames.len()).map(|index| self.totals.get(index).map(|length| length as usize));
        let lengths = lengths.collect::<Result<Vec<usize>, SplatError>>()?;
        if lengths.iter().sum::<usize>() > most {
            return Ok(apart());
        }
        Ok(sort_by_tile(frames, by_depth, &lengths).into_iter().map(Some).collect())
    }
}

impl Debug for Batch {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_struct("Batch").finish_non_exhaustive()
    }
}
