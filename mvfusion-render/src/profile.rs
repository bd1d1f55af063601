//! How long the parts of a training step take.
//!
//! Whoever calls an op says which part of the step it belongs to, by [`measure`]; an op that has a backward pass remembers
//! that part, so that its share of `backward()` is found there as well. Time is counted once: what an inner part takes is
//! not the outer one's. The clock is that of the calling thread, on which the CPU ops run; on a GPU, where a call returns
//! before the work is done, these are the times of the calls.

use std::cell::RefCell;
use std::time::{Duration, Instant};

/// A part of a training step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// HexPlane look-up, forward and backward.
    LookUp,
    /// Trunk and heads, forward and backward.
    Network,
    /// Motion-variance encoder, forward and the perceptron's backward.
    Mvg,
    /// Temporal attention with its neighbour tokens, forward and the perceptrons' backward.
    Mfta,
    /// Projection, sorting and blending.
    SplatForward,
    /// Their adjoint.
    SplatBackward,
    /// Waiting for the photos of a batch and moving them to the device.
    Photos,
    /// Blending of the branches and losses, forward.
    Loss,
    /// What remains of the backward pass: the losses' part and small tensor operations.
    BackwardRest,
    /// Adam.
    Optimiser,
    /// Densification statistics and changes of rows.
    Densify,
    /// Motion statistics.
    Refresh,
}

impl Part {
    /// All parts.
    pub const ALL: [Self; 12] = [
        Self::LookUp,
        Self::Network,
        Self::Mvg,
        Self::Mfta,
        Self::SplatForward,
        Self::SplatBackward,
        Self::Photos,
        Self::Loss,
        Self::BackwardRest,
        Self::Optimiser,
        Self::Densify,
        Self::Refresh,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::LookUp => "look_up",
            Self::Network => "network",
            Self::Mvg => "mvg",
            Self::Mfta => "mfta",
            Self::SplatForward => "splat_forward",
            Self::SplatBackward => "splat_backward",
            Self::Photos => "photos",
            Self::Loss => "loss",
            Self::BackwardRest => "backward_rest",
            Self::Optimiser => "optimiser",
            Self::Densify => "densify",
            Self::Refresh => "refresh",
        }
    }

    /// Whether whatever is called within counts as this part.
    fn owns_what_it_calls(self) -> bool {
        matches!(self, Self::Mvg | Self::Mfta | Self::Refresh)
    }

    /// The part that the backward pass of an op belongs to.
    pub(crate) fn backward(self) -> Self {
        match self {
            Self::SplatForward => Self::SplatBackward,
            other => other,
        }
    }
}

/// Time by part, as [`Part::ALL`] lists them.
pub type PartTimes = [Duration; Part::ALL.len()];

#[derive(Default)]
struct Clock {
    totals: PartTimes,
    /// The parts under way, outermost first.
    open: Vec<Part>,
    /// When the innermost of them was last entered or come back to.
    since: Option<Instant>,
}

impl Clock {
    /// Credits the time until now to the innermost part.
    fn credit(&mut self) {
        let now = Instant::now();
        if let (Some(&part), Some(since)) = (self.open.last(), self.since) {
            self.totals[part as usize] += now - since;
        }
        self.since = Some(now);
    }
}

thread_local! {
    static CLOCK: RefCell<Clock> = RefCell::default();
}

/// Leaves the innermost part when dropped, even by a panic.
struct Leave;

impl Drop for Leave {
    fn drop(&mut self) {
        CLOCK.with_borrow_mut(|clock| {
            clock.credit();
            clock.open.pop();
        });
    }
}

/// Does `work` as `part` of a step; within MVG, MFTA and the motion statistics it stays theirs.
pub fn measure<R>(part: Part, work: impl FnOnce() -> R) -> R {
    CLOCK.with_borrow_mut(|clock| {
        clock.credit();
        let owner = clock.open.last().copied().filter(|part| part.owns_what_it_calls());
        clock.open.push(owner.unwrap_or(part));
    });
    let _leave = Leave;
    work()
}

/// The part under way.
pub(crate) fn current() -> Option<Part> {
    CLOCK.with_borrow(|clock| clock.open.last().copied())
}

/// Does the backward pass of an op that was called as `part`.
pub(crate) fn measure_backward<R>(part: Option<Part>, work: impl FnOnce() -> R) -> R {
    match part {
        Some(part) => measure(part.backward(), work),
        None => work(),
    }
}

/// The times since the last call on this thread.
pub fn take() -> PartTimes {
    CLOCK.with_borrow_mut(|clock| std::mem::take(&mut clock.totals))
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAP: Duration = Duration::from_millis(2);

    fn nap() {
        std::thread::sleep(NAP);
    }

    fn of(times: &PartTimes, part: Part) -> Duration {
        times[part as usize]
    }

    #[test]
    fn the_parts_stand_in_their_own_order() {
        assert!(Part::ALL.iter().enumerate().all(|(index, &part)| part as usize == index));
    }

    #[test]
    fn an_inner_part_is_not_counted_twice() {
        take();
        let started = Instant::now();
        measure(Part::Loss, || {
            nap();
            measure(Part::Network, nap);
        });
        let (elapsed, times) = (started.elapsed(), take());
        assert!(of(&times, Part::Loss) >= NAP && of(&times, Part::Network) >= NAP);
        assert!(times.iter().sum::<Duration>() <= elapsed);
        assert_eq!(take(), PartTimes::default());
    }

    #[test]
    fn what_attention_calls_is_its_own() {
        take();
        measure(Part::Mfta, || measure(Part::Network, nap));
        let times = take();
        assert_eq!(of(&times, Part::Network), Duration::ZERO);
        assert!(of(&times, Part::Mfta) >= NAP);
    }
}
