//! What Adam's kernel and its CPU twin share.

/// The largest gradient that Adam takes for what it is: its square is far from overflowing in single precision.
pub const LARGEST_GRADIENT: f64 = 1e18;
