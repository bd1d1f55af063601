//! A tile's Gaussians in shared memory, one batch at a time.
//!
//! A unit processes a few neighbouring pixels of one row of the tile. It reads a Gaussian once for all of them. From
//! each batch it blends only the Gaussians whose ellipse meets its row.

use cubecl::prelude::*;

use super::tiles::{splat_at, tiles_along};
use crate::splat::{COLOUR_CHANNELS, PROJECTED_LEN, TILE, TILE_PIXELS, depth_channel, feature_count, projected_row};

/// Four numbers that are read at once.
pub type Four = Vector<f32, Const<4>>;

/// Numbers of a [`Four`].
pub const FOUR: usize = 4;

/// Bytes of a [`Four`].
pub(super) const FOUR_BYTES: usize = FOUR * size_of::<f32>();

/// Vector `vector` of a list of numbers.
#[cube]
pub(super) fn four_of(numbers: &Array<f32>, #[comptime] vector: usize) -> Four {
    let mut four = Four::new(0.0f32);
    #[unroll]
    for part in 0..FOUR {
        four.insert(part, numbers[comptime!(FOUR * vector + part)]);
    }
    four
}

/// Vectors in a [`StagedHead`], which precedes the channels of a staged Gaussian.
const HEAD: usize = 2;

/// Bits per word in a row's list of Gaussians.
pub(super) const WORD: usize = 32;

/// Neighbouring pixels that a unit of a GPU blends. It reads each Gaussian once for all of them, and enough units
/// remain.
pub const GPU_SPAN: usize = 4;

/// Preferred bytes of shared memory per cube on a GPU, so that several cubes are resident at once.
pub const GPU_MEMORY: usize = 16 << 10;

/// How a tile is divided among the units.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TileShare {
    /// Neighbouring pixels per unit: a divisor of [`TILE`].
    pub span: usize,
    /// Blended channels: colour, features, depth.
    pub channels: usize,
    /// Gaussians per batch.
    pub batch: usize,
}

impl TileShare {
    /// Units per cube.
    pub const fn units(&self) -> usize {
        TILE_PIXELS / self.span
    }

    /// Units per row.
    pub(super) const fn spans(&self) -> usize {
        TILE / self.span
    }

    /// Vectors per staged Gaussian.
    pub(super) const fn vectors(&self) -> usize {
        HEAD + self.channels.div_ceil(FOUR)
    }

    /// Bytes of shared memory per batch.
    pub(super) const fn bytes(&self) -> usize {
        self.batch * (FOUR_BYTES * self.vectors() + size_of::<u32>())
    }
}

/// The neighbouring pixels of a row that a unit processes.
#[derive(CubeType, Clone, Copy)]
pub(super) struct UnitPixels {
    /// Number of the tile.
    pub tile: u32,
    /// The tile's first column of pixels.
    pub left: u32,
    /// The tile's first row.
    pub top: u32,
    /// Column of the first pixel within the tile.
    pub column: u32,
    /// Row within the tile.
    pub row: u32,
}

/// The pixels that this unit processes in the cube's tile of an image that is `width` pixels wide.
#[cube]
pub(super) fn unit_pixels(width: u32, #[comptime] share: TileShare) -> UnitPixels {
    let tile = CUBE_POS as u32;
    let columns = tiles_along(width);
    let spans = comptime!(share.spans() as u32);
    UnitPixels {
        tile,
        left: tile % columns * comptime!(TILE as u32),
        top: tile / columns * comptime!(TILE as u32),
        column: UNIT_POS % spans * comptime!(share.span as u32),
        row: UNIT_POS / spans,
    }
}

/// Whether the unit's pixel `p` is in the image.
#[cube]
pub(super) fn is_inside(pixels: &UnitPixels, #[comptime] p: usize, width: u32, height: u32) -> bool {
    pixels.left + pixels.column + comptime!(p as u32) < width && pixels.top + pixels.row < height
}

/// Index of the unit's pixel `p` in the image.
#[cube]
pub(super) fn in_picture(pixels: &UnitPixels, #[comptime] p: usize, width: u32) -> usize {
    ((pixels.top + pixels.row) * width + pixels.left + pixels.column) as usize + p
}

/// Index of the unit's pixel `p` in a plane `[tiles, TILE_PIXELS]`.
#[cube]
pub(super) fn in_tiles(pixels: &UnitPixels, #[comptime] p: usize) -> usize {
    pixels.tile as usize * TILE_PIXELS + (pixels.row * comptime!(TILE as u32) + pixels.column) as usize + p
}

/// Stages a batch for the units' tile: the `count` Gaussians of `sorted` from `first` on. `rows` gets a bit for each
/// row of the tile in which a Gaussian may be visible.
#[cube]
pub(super) fn stage_batch(
    records: &[f32],
    features: &[f32],
    sorted: &[i32],
    first: u32,
    count: u32,
    pixels: &UnitPixels,
    staged: &mut Shared<[Four]>,
    rows: &mut Shared<[u32]>,
    #[comptime] share: TileShare,
) {
    let (left, top) = (f32::cast_from(pixels.left), f32::cast_from(pixels.top));
    let mut k = UNIT_POS;
    while k < count {
        let id = sorted[(first + k) as usize] as usize;
        stage(records, features, id, k as usize, left, top, staged, rows, share);
        k += comptime!(share.units() as u32);
    }
}

/// A staged Gaussian without its channels.
#[derive(CubeType, Clone, Copy)]
pub(super) struct StagedHead {
    /// Distance from the centre to the tile's first pixel, along x.
    pub x: f32,
    /// Distance from the centre to the tile's first pixel, along y.
    pub y: f32,
    /// Half curvature along x.
    pub half_x: f32,
    /// Shear.
    pub slope: f32,
    /// Half curvature that remains along y.
    pub half_y: f32,
    /// Opacity.
    pub opacity: f32,
}

/// Writes a head to the vectors from `at` on; [`head_at()`] reads it.
#[cube]
fn write_head(staged: &mut Shared<[Four]>, at: usize, head: &StagedHead) {
    let mut shape = Four::new(0.0f32);
    shape.insert(0usize, head.x);
    shape.insert(1usize, head.y);
    shape.insert(2usize, head.half_x);
    shape.insert(3usize, head.slope);
    staged[at] = shape;
    let mut rest = Four::new(0.0f32);
    rest.insert(0usize, head.half_y);
    rest.insert(1usize, head.opacity);
    staged[at + 1] = rest;
}

/// Reads the head of the Gaussian whose vectors start at `at`.
#[cube]
pub(super) fn head_at(staged: &Shared<[Four]>, at: usize) -> StagedHead {
    let (shape, rest) = (staged[at], staged[at + 1]);
    StagedHead {
        x: shape.extract(0usize),
        y: shape.extract(1usize),
        half_x: shape.extract(2usize),
        slope: shape.extract(3usize),
        half_y: rest.extract(0usize),
        opacity: rest.extract(1usize),
    }
}

/// Stages Gaussian `id` as number `k` of its batch.
#[cube]
fn stage(
    records: &[f32],
    features: &[f32],
    id: usize,
    k: usize,
    left: f32,
    top: f32,
    staged: &mut Shared<[Four]>,
    rows: &mut Shared<[u32]>,
    #[comptime] share: TileShare,
) {
    let splat = splat_at(records, id);
    let head = StagedHead {
        x: left + 0.5f32 - splat.centre.x,
        y: top + 0.5f32 - splat.centre.y,
        half_x: 0.5f32 * splat.curve_x,
        slope: splat.slope,
        half_y: 0.5f32 * splat.curve_y,
        opacity: splat.opacity,
    };
    let at = k * comptime!(share.vectors());
    write_head(staged, at, &head);
    let feature_count = comptime!(feature_count(share.channels));
    #[unroll]
    for vector in 0..comptime!(share.channels.div_ceil(FOUR)) {
        let mut values = Four::new(0.0f32);
        #[unroll]
        for part in 0..FOUR {
            let channel = comptime!(FOUR * vector + part);
            if comptime!(channel < COLOUR_CHANNELS) {
                values.insert(part, records[id * PROJECTED_LEN + comptime!(projected_row::RED + channel)]);
            } else if comptime!(channel < depth_channel(share.channels)) {
                values.insert(part, features[id * feature_count + comptime!(channel - COLOUR_CHANNELS)]);
            } else if comptime!(channel == depth_channel(share.channels)) {
                values.insert(part, splat.depth);
            }
        }
        staged[at + HEAD + vector] = values;
    }
    rows[k] = rows_met(head.y, head.half_y, splat.reach);
}

/// A bit for each row of the tile where `half_y dy²`, the minimum of sigma in the row, is within the reach. `y` is dy
/// in the first row.
#[cube]
fn rows_met(y: f32, half_y: f32, reach: f32) -> u32 {
    let last = comptime!(TILE as f32 - 1.0);
    let far = (max(reach, 0.0f32) / half_y).sqrt();
    let low = clamp((-far - y).ceil(), 0.0f32, last + 1.0f32);
    let high = clamp((far - y).floor(), -1.0f32, last);
    let below = (1u32 << u32::cast_from(high + 1.0f32)) - 1u32;
    let before = (1u32 << u32::cast_from(low)) - 1u32;
    below & !before
}

/// The Gaussians of a batch, from number `first` on, whose ellipse meets `row`: one bit each.
#[cube]
pub(super) fn met_by_row(rows: &Shared<[u32]>, first: u32, count: u32, row: u32) -> u32 {
    let mut met = 0u32;
    for i in 0..min(count - first, comptime!(WORD as u32)) {
        met |= ((rows[(first + i) as usize] >> row) & 1u32) << i;
    }
    met
}

/// A staged Gaussian with the values that a unit's pixels need.
#[derive(CubeType)]
pub(super) struct Staged {
    /// `u`, the sheared distance along x, at the unit's first pixel.
    pub u: f32,
    /// Half curvature along x.
    pub half_x: f32,
    /// The part of sigma that is constant in the row.
    pub row_sigma: f32,
    /// Opacity.
    pub opacity: f32,
    /// The values to blend.
    pub values: Array<f32>,
}

/// Reads Gaussian `k` of a batch.
#[cube]
pub(super) fn staged_at(staged: &Shared<[Four]>, k: u32, pixels: &UnitPixels, #[comptime] share: TileShare) -> Staged {
    let at = k as usize * comptime!(share.vectors());
    let head = head_at(staged, at);
    let dy = head.y + f32::cast_from(pixels.row);
    let mut values = Array::<f32>::new(comptime!(share.channels));
    #[unroll]
    for vector in 0..comptime!(share.channels.div_ceil(FOUR)) {
        let four = staged[at + HEAD + vector];
        #[unroll]
        for part in 0..comptime!((share.channels - FOUR * vector).min(FOUR)) {
            values[comptime!(FOUR * vector + part)] = four.extract(part);
        }
    }
    Staged {
        u: head.x + f32::cast_from(pixels.column) + head.slope * dy,
        half_x: head.half_x,
        row_sigma: head.half_y * dy * dy,
        opacity: head.opacity,
        values,
    }
}
