//! Which pixels of the training views show something that moves, whoever found it out.

use glam::DVec2;
use image::{GrayImage, Luma};

use super::MovingPixelsOptions;
use super::film::{Keep, MotionFilm};
use crate::{DataError, Scene};

/// Which pixels of the training views show something that moves.
///
/// It is kept at a size that is reduced by a whole factor, and asked in pixels of the full size.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MovingPixels {
    /// By training view; none where nothing is known.
    maps: Vec<Option<MotionMap>>,
}

/// What moves in one picture: a byte for each block of `factor` by `factor` pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionMap {
    /// Pixels of the picture.
    width: usize,
    height: usize,
    factor: usize,
    /// Row by row.
    blocks: Vec<PixelMotion>,
}

/// What is known of the motion of a block of pixels, in one byte: whether it counts, whether it moves, and by how many
/// levels it differs from what is still.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelMotion(u8);

impl PixelMotion {
    /// Largest difference that is told apart, 8-bit levels: more weighs no more.
    pub const MOST: u8 = 63;
    const COUNTS: u8 = 1 << 6;
    const MOVES: u8 = 1 << 7;
    /// A block that the view's mask takes out: it neither moves nor says that a place is still.
    pub const IGNORED: Self = Self(0);

    /// A block that differs by so many 8-bit levels from what is still there and stays.
    pub fn still(difference: u8) -> Self {
        Self(Self::COUNTS | difference.min(Self::MOST))
    }

    /// A block that differs by so many 8-bit levels and moves.
    pub fn moving(difference: u8) -> Self {
        Self(Self::MOVES | Self::still(difference).0)
    }

    /// Whether the view's mask, if there is one, lets it count.
    pub fn counts(self) -> bool {
        self.0 & Self::COUNTS != 0
    }

    /// Whether it shows something that moves.
    pub fn moves(self) -> bool {
        self.0 & Self::MOVES != 0
    }

    /// Difference to what is still, 8-bit levels, at most [`PixelMotion::MOST`].
    pub fn difference(self) -> u8 {
        self.0 & Self::MOST
    }
}

impl MotionMap {
    /// The map of a picture of `width` by `height` pixels, of blocks row by row, each of `factor` by `factor` pixels
    /// but for those cut off by the edge; `None` if their number is another.
    pub fn new((width, height): (usize, usize), factor: usize, blocks: Vec<PixelMotion>) -> Option<Self> {
        let fits = factor > 0 && width.div_ceil(factor) * height.div_ceil(factor) == blocks.len();
        fits.then_some(Self { width, height, factor, blocks })
    }

    /// The block at a position in pixels of the full size, as [`Camera::project`](crate::Camera::project) gives it;
    /// `None` outside of the picture.
    pub fn at(&self, position: DVec2) -> Option<PixelMotion> {
        self.index(position).map(|index| self.blocks[index])
    }

    /// Number of the block at a position in pixels of the full size.
    #[inline]
    pub(super) fn index(&self, position: DVec2) -> Option<usize> {
        // What is not a number is in no picture.
        let inside =
            position.x >= 0.0 && position.y >= 0.0 && position.x < self.width as f64 && position.y < self.height as f64;
        let block = |coordinate: f64| coordinate as usize / self.factor;
        inside.then(|| block(position.y) * self.columns() + block(position.x))
    }

    /// Blocks in a row.
    pub(super) fn columns(&self) -> usize {
        self.width.div_ceil(self.factor)
    }

    /// Row by row.
    pub(super) fn blocks(&self) -> &[PixelMotion] {
        &self.blocks
    }

    /// Corners of a block in pixels of the full size: top left, bottom right.
    pub(super) fn corners(&self, index: usize) -> [DVec2; 2] {
        let (column, row) = (index % self.columns(), index / self.columns());
        let first = DVec2::new((column * self.factor) as f64, (row * self.factor) as f64);
        let end = DVec2::new(self.width as f64, self.height as f64);
        [first, (first + self.factor as f64).min(end)]
    }

    /// Share of the blocks that count which move; 0 where none counts.
    pub fn share(&self) -> f64 {
        let counted = self.blocks.iter().filter(|block| block.counts()).count();
        let moving = self.blocks.iter().filter(|block| block.moves()).count();
        moving as f64 / counted.max(1) as f64
    }

    /// How much moves: the sum over the moving blocks of their difference and one.
    pub fn amount(&self) -> u64 {
        let moving = self.blocks.iter().filter(|block| block.moves());
        moving.map(|block| u64::from(block.difference()) + 1).sum()
    }

    /// The picture at full size: 255 where something moves, 0 elsewhere.
    pub fn mask(&self) -> GrayImage {
        let columns = self.columns();
        GrayImage::from_fn(self.width as u32, self.height as u32, |x, y| {
            let block = self.blocks[y as usize / self.factor * columns + x as usize / self.factor];
            Luma([if block.moves() { 255 } else { 0 }])
        })
    }
}

impl MovingPixels {
    /// What moves in the views of synchronised cameras that stand still; `None` where the scene has no three such
    /// cameras with three moments in common. Held-out views are not opened.
    ///
    /// # Errors
    /// [`DataError::Image`] if a picture or mask cannot be read.
    pub fn of(scene: &Scene, options: &MovingPixelsOptions) -> Result<Option<Self>, DataError> {
        Ok(MotionFilm::make(scene, options, Keep::Motion)?.map(MotionFilm::into_moving))
    }

    /// From a map for each training view; none where nothing is known of a view.
    pub fn from_maps(maps: Vec<Option<MotionMap>>) -> Self {
        Self { maps }
    }

    /// What moves in a training view, by its number; `None` where nothing is known.
    pub fn map(&self, view: usize) -> Option<&MotionMap> {
        self.maps.get(view)?.as_ref()
    }

    /// Whether a training view shows something that moves at a position in pixels of the full size, as
    /// [`Camera::project`](crate::Camera::project) gives it. Outside of the picture and in views of which nothing is
    /// known nothing moves.
    pub fn is_moving(&self, view: usize, position: DVec2) -> bool {
        self.map(view).and_then(|map| map.at(position)).is_some_and(PixelMotion::moves)
    }

    /// A training view's mask at full size, 255 where something moves; `None` where nothing is known.
    pub fn mask(&self, view: usize) -> Option<GrayImage> {
        self.map(view).map(MotionMap::mask)
    }

    /// Share of a training view's pixels that move, of those that count; `None` where nothing is known.
    pub fn share(&self, view: usize) -> Option<f64> {
        self.map(view).map(MotionMap::share)
    }

    /// Mean of [`MovingPixels::share`] over the views of which something is known; 0 where there is none.
    pub fn mean_share(&self) -> f64 {
        let known = self.maps.iter().flatten();
        let count = known.clone().count();
        known.map(MotionMap::share).sum::<f64>() / count.max(1) as f64
    }
}
