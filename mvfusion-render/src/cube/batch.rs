//! Frames that are rendered together: their tile lists are made at once, and the host waits for the device once.

use std::fmt::{self, Debug, Formatter};
use std::mem;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use super::bins::{Bins, Run};
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
    /// The frames whose lists are not made yet.
    frames: Vec<Arc<ProjectedFrame>>,
    /// The lists, until they are taken; none for a frame whose lists do not fit.
    lists: Vec<Option<Bins>>,
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

    /// Takes the lists of a frame of this index. Its largest buffer will have `pair_bytes` per pair of a Gaussian and a
    /// tile. The first call makes the lists of all frames. This is the only place where the host waits for the device.
    ///
    /// # Errors
    /// If the device cannot bind such a buffer, the number of pairs overflows an index, or the device fails.
    pub(super) fn take_lists(
        &self,
        frame: &Arc<ProjectedFrame>,
        index: usize,
        pair_bytes: u64,
    ) -> Result<Bins, SplatError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if !state.frames.is_empty() {
            // Each frame is kept by its holder alone from here on.
            let frames = mem::take(&mut state.frames);
            state.lists = self.sort(&frames, pair_bytes)?;
        }
        let pairs = self.totals.get(index)?;
        frame.frame.check_lists(pairs, pair_bytes)?;
        // Lists that fit alone may not have fitted beside others, or with their `pair_bytes`.
        let ready = state.lists.get_mut(index).and_then(Option::take);
        Ok(ready.unwrap_or_else(|| {
            let frames = std::slice::from_ref(frame);
            let begins = sort_by_depth(frames);
            let run = Run { frames, lengths: &[pairs], begins: &begins, gaussians_before: 0, pairs_before: 0 };
            // Proof: there are lists for each frame.
            run.sort_by_tile().pop().expect("one")
        }))
    }

    /// The lists of all frames. Those with few Gaussians or pairs are sorted together: a sort consists of many short
    /// launches, which no longer matter when each is long.
    fn sort(&self, frames: &[Arc<ProjectedFrame>], pair_bytes: u64) -> Result<Vec<Option<Bins>>, SplatError> {
        let counts: Vec<u32> = frames.iter().map(|frame| frame.frame.count() as u32).collect();
        // All of these are launched before the host waits.
        let groups = runs(&counts).into_iter().map(|group| (sort_by_depth(&frames[group.clone()]), group));
        let groups: Vec<_> = groups.collect();
        let lengths =
            (0..frames.len()).map(|index| self.totals.get(index)).collect::<Result<Vec<u32>, SplatError>>()?;
        let fits = |index: usize| frames[index].frame.check_lists(lengths[index], pair_bytes).is_ok();
        let sum = |numbers: &[u32]| numbers.iter().map(|&number| number as usize).sum::<usize>();
        let mut lists = Vec::new();
        for (begins, group) in groups {
            // The positions of pairs have saturated otherwise.
            let is_counted = sum(&lengths[group.clone()]) < u32::MAX as usize;
            for run in runs(&lengths[group.clone()]) {
                let own = group.start + run.start..group.start + run.end;
                if is_counted && own.clone().all(fits) {
                    let run = Run {
                        frames: &frames[own.clone()],
                        lengths: &lengths[own.clone()],
                        begins: &begins,
                        gaussians_before: sum(&counts[group.start..own.start]),
                        pairs_before: sum(&lengths[group.start..own.start]),
                    };
                    lists.extend(run.sort_by_tile().into_iter().map(Some));
                } else {
                    lists.extend(own.map(|_| None));
                }
            }
        }
        Ok(lists)
    }
}

/// Splits frames of these sizes into runs that are sorted together.
fn runs(sizes: &[u32]) -> Vec<Range<usize>> {
    let most = most_sorted_together();
    let mut runs: Vec<Range<usize>> = Vec::new();
    let mut room = 0;
    for (index, &size) in sizes.iter().enumerate() {
        match runs.last_mut() {
            Some(run) if size as usize <= room => run.end += 1,
            _ => {
                room = most.max(size as usize);
                runs.push(index..index + 1);
            }
        }
        room -= size as usize;
    }
    runs
}

impl Debug for Batch {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_struct("Batch").finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cube::gpu::sort_apart;

    #[test]
    fn runs_hold_all_frames_in_order_and_only_one_alone_is_longer_than_the_most() {
        let found = sort_apart(10, || runs(&[4, 6, 1, 30, 0, 0, 5, 6, 11, 10]));
        assert_eq!(found, [0..2, 2..3, 3..6, 6..7, 7..8, 8..9, 9..10]);
        assert!(runs(&[]).is_empty());
    }
}
