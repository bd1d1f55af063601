//! Vector instructions chosen at run time, for loops that the compiler vectorises by itself.
//!
//! No instruction set changes a result: sums keep their written order and nothing is contracted.

use pulp::{Arch, Simd, WithSimd};

/// A closure that is called by reference: a call by value goes through a shim that is compiled for the baseline.
struct Work<F>(F);

impl<R, F: FnMut() -> R> WithSimd for Work<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, _: S) -> R {
        (self.0)()
    }
}

/// Calls `work` compiled for the best instruction set of this machine. The closure and all that it calls in its loops
/// must be `#[inline(always)]`; what is not is compiled for the baseline.
#[inline]
pub(crate) fn vectorised<R>(work: impl FnMut() -> R) -> R {
    Arch::new().dispatch(Work(work))
}
