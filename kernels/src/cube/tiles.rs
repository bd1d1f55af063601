//! The tiles that a Gaussian touches, and the tiles' lists. CPU twin: `splat/cpu/tiles.rs`.

use cubecl::prelude::*;

use super::maths::{Pair, constant};
use super::view::View;
use crate::splat::{MAX_CENTRE, PROJECTED_LEN, TILE, TOUCH_ROUNDINGS, projected_row};

/// A projected Gaussian without its colour: the record's head.
#[derive(CubeType, Clone, Copy)]
pub struct Splat {
    /// Centre in pixels.
    pub centre: Pair,
    /// See [`crate::splat::Projected`], also for the following fields.
    pub curve_x: f32,
    /// Shear.
    pub slope: f32,
    /// Curvature that remains along y.
    pub curve_y: f32,
    /// Opacity.
    pub opacity: f32,
    /// Largest visible sigma.
    pub reach: f32,
    /// Depth.
    pub depth: f32,
}

/// Reads the head of record `index`.
#[cube]
pub fn splat_at(records: &[f32], index: usize) -> Splat {
    let first = index * PROJECTED_LEN;
    Splat {
        centre: Pair { x: records[first + projected_row::CENTRE_X], y: records[first + projected_row::CENTRE_Y] },
        curve_x: records[first + projected_row::CURVE_X],
        slope: records[first + projected_row::SLOPE],
        curve_y: records[first + projected_row::CURVE_Y],
        opacity: records[first + projected_row::OPACITY],
        reach: records[first + projected_row::REACH],
        depth: records[first + projected_row::DEPTH],
    }
}

/// A rectangle of tiles, ends exclusive.
#[derive(CubeType, Clone, Copy)]
pub struct TileRectangle {
    /// First column.
    pub left: u32,
    /// First row.
    pub top: u32,
    /// One past the last column.
    pub right: u32,
    /// One past the last row.
    pub bottom: u32,
}

/// Tiles along an axis of `size` pixels.
#[cube]
pub fn tiles_along(size: u32) -> u32 {
    (size + comptime!(TILE as u32 - 1)) / comptime!(TILE as u32)
}

/// The tiles that a Gaussian of these radii reaches. It uses integers, so that it matches the twin's double precision.
#[cube]
pub fn tile_rectangle(
    centre: &Pair,
    radius_x: i32,
    radius_y: i32,
    view: &View,
    #[comptime] square: bool,
) -> TileRectangle {
    let (left, right) = tile_range(centre.x, radius_x, view.width, square);
    let (top, bottom) = tile_range(centre.y, radius_y, view.height, square);
    TileRectangle { left, top, right, bottom }
}

#[cube]
fn tile_range(middle: f32, radius: i32, size: u32, #[comptime] square: bool) -> (u32, u32) {
    let tile = comptime!(TILE as i32);
    let tiles = tiles_along(size) as i32;
    let bound = comptime!(MAX_CENTRE as f32);
    let middle = clamp(middle, -bound, bound);
    if comptime!(square) {
        // The arithmetic of 3DGS: pixel centres at integers, and truncation.
        let whole = i32::cast_from((middle - 0.5f32).floor());
        let low = max(whole - radius, 0) / tile;
        let high = max(whole + radius + tile - 1, 0) / tile;
        (u32::cast_from(min(low, tiles)), u32::cast_from(min(high, tiles)))
    } else {
        let first = i32::cast_from(middle.floor()) - radius;
        let last = i32::cast_from(middle.ceil()) + radius;
        let low = max(first, 0) / tile;
        let high = max(last + tile - 1, 0) / tile;
        // Outside the image, but possibly within its last tile.
        let beyond = first >= i32::cast_from(size);
        (select(beyond, 0u32, u32::cast_from(min(low, tiles))), select(beyond, 0u32, u32::cast_from(min(high, tiles))))
    }
}

/// Whether the ellipse at the smallest visible alpha touches the tile whose first pixel has its corner at `(x, y)`.
/// Rounding errors never exclude a pixel.
#[cube]
pub fn touches_tile(splat: &Splat, x: f32, y: f32) -> bool {
    let span = comptime!(TILE as f32 - 1.0);
    let (low_x, low_y) = (x + 0.5f32 - splat.centre.x, y + 0.5f32 - splat.centre.y);
    let (high_x, high_y) = (low_x + span, low_y + span);
    let nearest_x = min(max(0.0f32, low_x), high_x);
    let nearest_y = min(max(0.0f32, low_y), high_y);
    let rounding = constant(TOUCH_ROUNDINGS * 0.5 * f32::EPSILON as f64)
        * (max(low_x.abs(), high_x.abs())
            + splat.slope.abs() * max(low_y.abs(), high_y.abs())
            + splat.centre.x.abs()
            + splat.centre.y.abs() * splat.slope.abs());
    // The minimum over the box is on a side that faces the centre.
    let shear = splat.curve_x * splat.slope;
    let dy = min(max(-shear * nearest_x / (splat.curve_y + shear * splat.slope), low_y), high_y);
    let dx = min(max(-splat.slope * nearest_y, low_x), high_x);
    let sigma = min(sigma_at(splat, nearest_x, dy, rounding), sigma_at(splat, dx, nearest_y, rounding));
    let inside = nearest_x == 0.0f32 && nearest_y == 0.0f32;
    select(inside, splat.reach > 0.0f32, sigma <= splat.reach)
}

#[cube]
fn sigma_at(splat: &Splat, dx: f32, dy: f32, rounding: f32) -> f32 {
    let u = max((dx + splat.slope * dy).abs() - rounding, 0.0f32);
    0.5f32 * (splat.curve_x * u * u + splat.curve_y * dy * dy)
}

/// Number of tiles in a rectangle that the Gaussian touches.
#[cube]
pub fn count_tiles(splat: &Splat, rectangle: &TileRectangle) -> u32 {
    let mut count = 0u32;
    for row in rectangle.top..rectangle.bottom {
        for column in rectangle.left..rectangle.right {
            if touches_tile(splat, tile_corner(column), tile_corner(row)) {
                count += 1u32;
            }
        }
    }
    count
}

#[cube]
fn tile_corner(index: u32) -> f32 {
    f32::cast_from(index * comptime!(TILE as u32))
}

/// Marks the visible Gaussians of a frame: 1 for each that touches a tile, 0 for the others. `marks` and `all_touched`
/// are those of all frames, in which this one begins at `first`.
#[cube(launch)]
pub fn mark_visible(touched: &[u32], marks: &mut [u32], all_touched: &mut [u32], first: u32, count: u32) {
    let id = ABSOLUTE_POS;
    if id < count as usize {
        let own = touched[id];
        marks[first as usize + id] = select(own > 0u32, 1u32, 0u32);
        all_touched[first as usize + id] = own;
    }
}

/// Collects the visible Gaussians of a frame. The depth (as a sort key) and the index among those of all frames are
/// written at the rank of each.
///
/// `ranks` is the prefix sum of the visibility marks of all frames, see the module `scan`; this one begins at `first`.
#[cube(launch)]
pub fn collect_visible(
    records: &[f32],
    touched: &[u32],
    ranks: &[u32],
    keys: &mut [u32],
    ids: &mut [u32],
    first: u32,
    count: u32,
) {
    let id = ABSOLUTE_POS;
    if id < count as usize && touched[id] > 0u32 {
        let rank = ranks[first as usize + id] as usize;
        // Depths are positive, and positive floats sort like their bits.
        keys[rank] = u32::reinterpret(records[id * PROJECTED_LEN + projected_row::DEPTH]);
        ids[rank] = first + id as u32;
    }
}

/// The frame of each visible Gaussian, as a sort key. `firsts` are the first Gaussians of the frames.
#[cube(launch)]
pub fn frame_keys(ids: &[u32], firsts: &[u32], visible: &[u32], keys: &mut [u32], frames: u32) {
    let place = ABSOLUTE_POS;
    if (place as u32) < visible[0] {
        let id = ids[place];
        let mut frame = 0u32;
        for other in 1..frames {
            frame = select(id < firsts[other as usize], frame, other);
        }
        keys[place] = frame;
    }
}

/// The tile counts in order of depth; 0 after the last visible Gaussian.
#[cube(launch)]
pub fn counts_by_depth(ids: &[u32], touched: &[u32], visible: &[u32], counts: &mut [u32], count: u32) {
    let place = ABSOLUTE_POS;
    if place < count as usize {
        let mut own = 0u32;
        if (place as u32) < visible[0] {
            own = touched[ids[place] as usize];
        }
        counts[place] = own;
    }
}

/// Where the pairs of each visible Gaussian begin: the prefix sums of the counts by depth, `before`, by Gaussian.
#[cube(launch)]
pub fn begin_pairs(ids: &[u32], before: &[u32], visible: &[u32], begins: &mut [u32]) {
    let place = ABSOLUTE_POS;
    if (place as u32) < visible[0] {
        begins[ids[place] as usize] = before[place];
    }
}

/// A frame among those that are sorted together.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct FramePlace {
    /// Its first Gaussian among those sorted by depth.
    pub gaussian: u32,
    /// Pairs sorted by depth that lie before those sorted by tile.
    pub before: u32,
    /// Its first pair among those sorted by tile.
    pub pair: u32,
    /// Its first tile.
    pub tile: u32,
}

/// Writes every pair of a Gaussian of a frame and a touched tile, where the Gaussian's pairs begin, and the position of
/// each Gaussian's pairs within the frame.
///
/// A Gaussian has room for as many pairs as the projection counted. Different rounding may find fewer or more pairs
/// here, all on the edge of the ellipse. Missing pairs are assigned to a tile past the last; surplus pairs are dropped.
///
/// `tiles` and `owners` have an entry for each pair of all frames: its tile among those of all frames, each of which has
/// one past its last; and its Gaussian. The positions are the head of the `slots` of [`list_pairs()`].
#[cube(launch)]
pub fn emit_pairs(
    records: &[f32],
    radii: &[i32],
    touched: &[u32],
    begins: &[u32],
    tiles: &mut [u32],
    owners: &mut [u32],
    slots: &mut [i32],
    view: View,
    frame: FramePlace,
    count: u32,
    #[comptime] square: bool,
) {
    let id = ABSOLUTE_POS;
    if id < count as usize {
        let own = touched[id];
        let mut begin = frame.pair;
        if own > 0u32 {
            begin = begins[frame.gaussian as usize + id] - frame.before;
        }
        let end = begin + own;
        let mut at = begin;
        if own > 0u32 {
            let splat = splat_at(records, id);
            let rectangle = tile_rectangle(&splat.centre, radii[2 * id], radii[2 * id + 1], &view, square);
            let columns = tiles_along(view.width);
            for row in rectangle.top..rectangle.bottom {
                for column in rectangle.left..rectangle.right {
                    if at < end && touches_tile(&splat, tile_corner(column), tile_corner(row)) {
                        tiles[at as usize] = frame.tile + row * columns + column;
                        owners[at as usize] = id as u32;
                        at += 1u32;
                    }
                }
            }
        }
        slots[2 * id] = i32::cast_from(begin - frame.pair);
        slots[2 * id + 1] = i32::cast_from(at - begin);
        while at < end {
            tiles[at as usize] = frame.tile + tiles_along(view.width) * tiles_along(view.height);
            owners[at as usize] = id as u32;
            at += 1u32;
        }
    }
}

/// The tile lists of a frame from the sorted pairs of all: Gaussians by tile and depth, and the position of each pair
/// in the lists. `numbers` are the indices that the sorted pairs had before. The frame's pairs begin at `first`, the
/// positions behind the `head` of `slots`.
#[cube(launch)]
pub fn list_pairs(
    owners: &[u32],
    numbers: &[u32],
    sorted: &mut [i32],
    slots: &mut [i32],
    first: u32,
    pairs: u32,
    head: u32,
) {
    let place = ABSOLUTE_POS;
    if place < pairs as usize {
        let number = numbers[first as usize + place];
        sorted[place] = i32::cast_from(owners[number as usize]);
        slots[(head + number - first) as usize] = i32::cast_from(place as u32);
    }
}

/// The start of each tile's list: the first pair of that tile or a later one, by bisection. `count` is the number of
/// the frame's tiles.
#[cube(launch)]
pub fn find_starts(tiles: &[u32], starts: &mut [i32], frame: FramePlace, pairs: u32, count: u32) {
    let tile = ABSOLUTE_POS as u32;
    if tile <= count {
        let mut low = 0u32;
        let mut high = pairs;
        while low < high {
            let middle = (low + high) / 2u32;
            if tiles[(frame.pair + middle) as usize] < frame.tile + tile {
                low = middle + 1u32;
            } else {
                high = middle;
            }
        }
        starts[tile as usize] = i32::cast_from(low);
    }
}
