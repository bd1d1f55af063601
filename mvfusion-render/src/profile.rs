//! The duration of each part of a training step.
//!
//! The caller of an op assigns it to a part of the step with [`measure`]. An op with a backward pass remembers that
//! part, so that its share of `backward()` is attributed to the same part. Time is counted once: the time of an inner
//! part does not count for the outer one. The clock belongs to the calling thread, on which the CPU ops run. On a GPU,
//! a call returns before the work is done, so these are the times of the calls.

use std::cell::RefCell;
use std::time::{Duration, Instant};

/// A part of a training step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// HexPlane interpolation, forward and backward.
    LookUp,
    /// Trunk and heads, forward and backward.
    Network,
    /// Motion-variance encoder, forward, and the backward pass of its MLP.
    Mvg,
    /// Temporal attention with its neighbour tokens, forward, and the backward pass of its MLPs.
    Mfta,
    /// Projection, sorting and blending.
    SplatForward,
    /// The adjoint of projection and blending.
    SplatBackward,
    /// Waiting for the photos of a batch and moving them to the device.
    Photos,
    /// Blending of the branches and losses, forward.
    Loss,
    /// The rest of the backward pass: losses and small tensor operations.
    BackwardRest,
    /// Adam.
    Optimiser,
    /// Densification statistics and row changes.
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

    /// Whether everything called within counts as this part.
    fn owns_what_it_calls(self) -> bool {
        matches!(self, Self::Mvg | Self::Mfta | Self::Refresh)
    }

    /// The part of the backward pass of an op.
    pub(crate) fn backward(self) -> Self {
        match self {
            Self::SplatForward => Self::SplatBackward,
            other => other,
        }
    }
}

/// Time per part, in the order of [`Part::ALL`].
pub type PartTimes = [Duration; Part::ALL.len()];

#[derive(Default)]
struct Clock {
    totals: PartTimes,
    /// The active parts, outermost first.
    open: Vec<Part>,
    /// When the innermost part was last entered or resumed.
    since: Option<Instant>,
}

impl Clock {
    /// Adds the time since then to the innermost part.
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

/// Leaves the innermost part when dropped, also during a panic.
struct Leave;

impl Drop for Leave {
    fn drop(&mut self) {
        CLOCK.with_borrow_mut(|clock| {
            clock.credit();
            clock.open.pop();
        });
    }
}

/// Runs `work` as `part` of a step. Within MVG, MFTA and the motion statistics, it counts as theirs.
pub fn measure<R>(part: Part, work: impl FnOnce() -> R) -> R {
    CLOCK.with_borrow_mut(|clock| {
        clock.credit();
        let owner = clock.open.last().copied().filter(|part| part.owns_what_it_calls());
        clock.open.push(owner.unwrap_or(part));
    });
    let _leave = Leave;
    work()
}

/// The innermost active part.
pub(crate) fn current() -> Option<Part> {
    CLOCK.with_borrow(|clock| clock.open.last().copied())
}

/// Runs the backward pass of an op that was called as `part`.
pub(crate) fn measure_backward<R>(part: Option<Part>, work: impl FnOnce() -> R) -> R {
    match part {
        Some(part) => measure(part.backward(), work),
        None => work(),
    }
}

/// Runs `work` without counting its time, for work that is not a part of a step.
pub fn uncounted<R>(work: impl FnOnce() -> R) -> R {
    /// Puts the clock back when dropped, also during a panic.
    struct Return(Clock);

    impl Drop for Return {
        fn drop(&mut self) {
            let mut clock = std::mem::take(&mut self.0);
            clock.since = Some(Instant::now());
            CLOCK.set(clock);
        }
    }

    let kept = CLOCK.with_borrow_mut(|clock| {
        clock.credit();
        std::mem::take(clock)
    });
    let _return = Return(kept);
    work()
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
    fn what_is_not_counted_leaves_the_times_as_they_were() {
        take();
        measure(Part::Loss, nap);
        measure(Part::Network, || uncounted(|| measure(Part::Loss, || std::thread::sleep(20 * NAP))));
        let times = take();
        assert!(of(&times, Part::Loss) >= NAP && times.iter().sum::<Duration>() < 20 * NAP, "{times:?}");
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
