//! The layout of all planes in one tensor.

use mvfusion_kernels::grid::{PAIRS, TIME};

/// The size of a HexPlane (METHOD §2.1).
#[derive(Clone, Debug, PartialEq)]
pub struct GridLayout {
    /// Features per cell, F.
    pub features: usize,
    /// Cells along x, y, z and t at multiplier 1.
    pub resolution: [usize; 4],
    /// The factor of the cells along x, y and z at each scale; t is not multiplied.
    pub multipliers: Vec<usize>,
}

/// One plane of a [`GridLayout`].
#[derive(Clone, Debug, PartialEq)]
pub struct PlaneLayout {
    /// Index of its multiplier.
    pub scale: usize,
    /// Pair of axes: 0 to 5 for xy, xz, xt, yz, yt, zt.
    pub pair: usize,
    /// Cells along the first coordinate of the pair, contiguous in memory.
    pub width: usize,
    /// Cells along the second coordinate of the pair, which is time for the pairs 2, 4 and 5.
    pub height: usize,
    /// The row of the planes' tensor with cell (0, 0); cell (row, column) is `row * width + column` rows further.
    pub first_cell: usize,
}

impl PlaneLayout {
    /// Whether the second coordinate is time.
    pub fn is_time(&self) -> bool {
        PAIRS[self.pair][1] == TIME
    }

    /// The number of cells.
    pub fn cells(&self) -> usize {
        self.width * self.height
    }
}

impl GridLayout {
    /// The number of cells of all planes.
    pub fn cells(&self) -> usize {
        self.planes().iter().map(PlaneLayout::cells).sum()
    }

    /// All planes in memory order: scale by scale, within a scale by pair.
    pub fn planes(&self) -> Vec<PlaneLayout> {
        let mut first_cell = 0;
        let mut planes = Vec::with_capacity(6 * self.multipliers.len());
        for scale in 0..self.multipliers.len() {
            let axes = self.axes(scale);
            for (pair, [first, second]) in PAIRS.into_iter().enumerate() {
                let plane = PlaneLayout { scale, pair, width: axes[first], height: axes[second], first_cell };
                first_cell += plane.cells();
                planes.push(plane);
            }
        }
        planes
    }

    /// Number of interpolated features: features per cell times the number of scales.
    pub fn feature_count(&self) -> usize {
        self.features * self.multipliers.len()
    }

    /// Cells along x, y, z and t at a scale.
    pub(crate) fn axes(&self, scale: usize) -> [usize; 4] {
        let [x, y, z, t] = self.resolution;
        let multiplier = self.multipliers[scale];
        [x * multiplier, y * multiplier, z * multiplier, t]
    }
}

/// The box of a grid in world coordinates. Its minimum corner is grid coordinate +1, its maximum corner -1 (METHOD
/// §2.1). Along a side of length zero, every point gets the first cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridBounds {
    /// The corner of the smallest coordinates.
    pub min: [f64; 3],
    /// The corner of the largest coordinates.
    pub max: [f64; 3],
}
