//! How a HexPlane's planes are made of the axes.

/// The axes of each plane of a scale, as indices of (x, y, z, t): first the width's, then the height's.
pub const PAIRS: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// The time axis.
pub const TIME: usize = 3;
