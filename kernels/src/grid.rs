//! The axes of a HexPlane's planes.

/// The two axes of each plane of a scale, as indices into (x, y, z, t): width first, then height.
pub const PAIRS: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// The time axis.
pub const TIME: usize = 3;
