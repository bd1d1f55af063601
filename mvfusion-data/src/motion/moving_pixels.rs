//! Moving pixels of the training views.

use glam::DVec2;
use image::{GrayImage, Luma};

/// The pixels of the training views that show motion.
///
/// They are stored at a size reduced by an integer factor, and addressed in full-size pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MovingPixels {
    /// By training view; `None` if unknown.
    maps: Vec<Option<MotionMap>>,
}

/// The motion in one image: a byte for each block of `factor` by `factor` pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionMap {
    /// Size of the image in pixels.
    width: usize,
    height: usize,
    factor: usize,
    /// Row by row.
    blocks: Vec<PixelMotion>,
}

/// The motion of a block in one byte: whether it is valid, whether it moves, and its difference from the still scene in
/// levels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelMotion(u8);

impl PixelMotion {
    /// Largest difference that is stored, in 8-bit levels. Larger ones have no more weight.
    pub const MOST: u8 = 63;
    const COUNTS: u8 = 1 << 6;
    const MOVES: u8 = 1 << 7;
    /// A block that the view's mask excludes. It is neither moving nor evidence of stillness.
    pub const IGNORED: Self = Self(0);

    /// A still block with this difference from the still scene, in 8-bit levels.
    pub fn still(difference: u8) -> Self {
        Self(Self::COUNTS | difference.min(Self::MOST))
    }

    /// A moving block with this difference, in 8-bit levels.
    pub fn moving(difference: u8) -> Self {
        Self(Self::MOVES | Self::still(difference).0)
    }

    /// Whether the view's mask, if any, includes it.
    pub fn counts(self) -> bool {
        self.0 & Self::COUNTS != 0
    }

    /// Whether it shows motion.
    pub fn moves(self) -> bool {
        self.0 & Self::MOVES != 0
    }

    /// Difference from the still scene in 8-bit levels, at most [`PixelMotion::MOST`].
    pub fn difference(self) -> u8 {
        self.0 & Self::MOST
    }
}

impl MotionMap {
    /// The map of an image of `width` by `height` pixels. `blocks` are stored row by row, each of `factor` by `factor`
    /// pixels. Blocks at the edge may be smaller. `None` if the number of blocks is wrong.
    pub fn new((width, height): (usize, usize), factor: usize, blocks: Vec<PixelMotion>) -> Option<Self> {
        let fits = factor > 0 && width.div_ceil(factor) * height.div_ceil(factor) == blocks.len();
        fits.then_some(Self { width, height, factor, blocks })
    }

    /// The block at a position in pixels of the full size, as [`Camera::project`](crate::Camera::project) returns it.
    /// `None` outside of the image.
    pub fn at(&self, position: DVec2) -> Option<PixelMotion> {
        self.index(position).map(|index| self.blocks[index])
    }

    /// The index of the block at a position in pixels of the full size.
    #[inline]
    pub(super) fn index(&self, position: DVec2) -> Option<usize> {
        // NaN is outside every image.
        let inside =
            position.x >= 0.0 && position.y >= 0.0 && position.x < self.width as f64 && position.y < self.height as f64;
        let block = |coordinate: f64| coordinate as usize / self.factor;
        inside.then(|| block(position.y) * self.columns() + block(position.x))
    }

    /// Blocks per row.
    pub(super) fn columns(&self) -> usize {
        self.width.div_ceil(self.factor)
    }

    /// Row by row.
    pub(super) fn blocks(&self) -> &[PixelMotion] {
        &self.blocks
    }

    /// Top left and bottom right corner of a block, in pixels of the full size.
    pub(super) fn corners(&self, index: usize) -> [DVec2; 2] {
        let (column, row) = (index % self.columns(), index / self.columns());
        let first = DVec2::new((column * self.factor) as f64, (row * self.factor) as f64);
        let end = DVec2::new(self.width as f64, self.height as f64);
        [first, (first + self.factor as f64).min(end)]
    }

    /// Moving fraction of the valid blocks; 0 if none is valid.
    pub fn share(&self) -> f64 {
        let counted = self.blocks.iter().filter(|block| block.counts()).count();
        let moving = self.blocks.iter().filter(|block| block.moves()).count();
        moving as f64 / counted.max(1) as f64
    }

    /// The amount of motion: the sum over moving blocks of their difference plus one.
    pub fn amount(&self) -> u64 {
        let moving = self.blocks.iter().filter(|block| block.moves());
        moving.map(|block| u64::from(block.difference()) + 1).sum()
    }

    /// The mask at full size: 255 where something moves, 0 elsewhere.
    pub fn mask(&self) -> GrayImage {
        let columns = self.columns();
        GrayImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            let block = self.blocks[y as usize / self.factor * columns + x as usize / self.factor];
            Luma([if block.moves() { 255 } else { 0 }])
        })
    }
}

impl MovingPixels {
    /// From a map for each training view; `None` for views with unknown motion.
    pub fn from_maps(maps: Vec<Option<MotionMap>>) -> Self {
        Self { maps }
    }

    /// The motion in a training view; `None` if unknown.
    pub fn map(&self, view: usize) -> Option<&MotionMap> {
        self.maps.get(view)?.as_ref()
    }

    /// Whether a training view shows motion at a position in full-size pixels, as
    /// [`Camera::project`](crate::Camera::project) returns it. `false` outside the image and in views with unknown
    /// motion.
    pub fn is_moving(&self, view: usize, position: DVec2) -> bool {
        self.map(view).and_then(|map| map.at(position)).is_some_and(PixelMotion::moves)
    }

    /// A training view's mask at full size, 255 where something moves; `None` if unknown.
    pub fn mask(&self, view: usize) -> Option<GrayImage> {
        self.map(view).map(MotionMap::mask)
    }

    /// Moving fraction of a training view's valid pixels; `None` if unknown.
    pub fn share(&self, view: usize) -> Option<f64> {
        self.map(view).map(MotionMap::share)
    }

    /// Mean of [`MovingPixels::share`] over the views with known motion; 0 if there are none.
    pub fn mean_share(&self) -> f64 {
        let known = self.maps.iter().flatten();
        let count = known.clone().count();
        known.map(MotionMap::share).sum::<f64>() / count.max(1) as f64
    }
}
