//! The tiles that a Gaussian reaches.

use mvfusion_kernels::splat::TILE;

use super::lanes::Lane;
use super::view::View;
use crate::splat::Extent;

/// A rectangle of tiles, ends exclusive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TileRectangle {
    pub low: [usize; 2],
    pub high: [usize; 2],
}

impl TileRectangle {
    /// The tiles that a Gaussian reaches, by the extent rule of the view.
    #[inline(always)]
    pub fn of<T: Lane>(centre: [T; 2], radii: [i32; 2], view: &View<T>) -> Self {
        let grid = view.grid();
        let size = [view.width, view.height];
        let side = TILE as f64;
        let (mut low, mut high) = ([0; 2], [0; 2]);
        for axis in 0..2 {
            let (middle, radius) = (centre[axis].wide(), f64::from(radii[axis]));
            let range = match view.extent {
                // The arithmetic of 3DGS: pixel centres at integers, and truncation.
                Extent::Square { .. } => [(middle - 0.5 - radius) / side, (middle - 0.5 + radius + side - 1.0) / side],
                Extent::PerAxis { .. } if middle + radius <= 0.0 || middle - radius >= size[axis] as f64 => [0.0, 0.0],
                Extent::PerAxis { .. } => [((middle - radius) / side).floor(), ((middle + radius) / side).ceil()],
            };
            // The conversion to `usize` saturates at zero.
            low[axis] = (range[0] as usize).min(grid[axis]);
            high[axis] = (range[1] as usize).min(grid[axis]);
        }
        Self { low, high }
    }

    /// Whether the rectangle contains no tile.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.low[0] >= self.high[0] || self.low[1] >= self.high[1]
    }
}
