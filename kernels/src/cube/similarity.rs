//! The similarity of two images over a Gaussian window, and its adjoint. CPU twin: `window/similarity.rs`.
//!
//! A cube is a tile of a plane, and keeps the sums down the columns in shared memory. There are four for each pixel:
//! through global memory, they would be most of what the losses read and write.

use cubecl::prelude::*;

use super::UNITS;
use super::window::{PlaneSize, taps_along, taps_down};

/// Columns and rows of a tile. It is wide, because the columns beside it are summed as well.
const TILE: [usize; 2] = [64, 4];
const _: () = assert!(TILE[0] * TILE[1] == UNITS);

/// Sums down a column of a similarity and of its adjoint: mean a, mean b, squares, product.
const SUMS: usize = 4;

/// Largest radius of a window whose sums fit into the 16 KiB of shared memory that every GPU has.
pub const MOST_RADIUS: usize = ((16 << 10) / (size_of::<f32>() * SUMS * TILE[1]) - TILE[0]) / 2;

/// Cubes for so many planes.
pub const fn tile_count(planes: usize, height: usize, width: usize) -> usize {
    planes * height.div_ceil(TILE[1]) * width.div_ceil(TILE[0])
}

/// The derivatives of a similarity that are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Derivatives {
    /// None.
    None,
    /// Those of the first image.
    First,
    /// Those of both.
    Both,
}

impl Derivatives {
    /// Maps that they are saved in: with respect to mean a, mean a² + b² and mean ab; for both images also mean b.
    pub const fn maps(self) -> usize {
        match self {
            Self::None => 0,
            Self::First => 3,
            Self::Both => 4,
        }
    }
}

/// The kind of similarity of two images.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SimilarityKind {
    /// SSIM.
    Ssim,
    /// The structure term.
    Structure,
}

/// Constants of a similarity (METHOD §4.4).
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct SimilarityConstants {
    /// Constant of SSIM's luminance term.
    pub c1: f32,
    /// Constant of SSIM's contrast term.
    pub c2: f32,
    /// Constant of the structure term.
    pub c3: f32,
    /// Upper bound of the structure term.
    pub structure_max: f32,
}

/// Where images begin in their buffers. Other planes may lie before them: a buffer can be bound from its middle on only
/// at multiples of the device's alignment.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct ImageStarts {
    /// The first number of the first image.
    pub a: u32,
    /// The first number of the second image.
    pub b: u32,
    /// The first number of the cotangent of the map.
    pub v_map: u32,
}

/// The similarity of two images and, if wanted, its `slopes` `[maps, planes, height, width]`, see [`Derivatives`]. Pixels
/// outside the images are black.
#[cube(launch_unchecked)]
pub fn similarity(
    a: &[f32],
    b: &[f32],
    weights: &[f32],
    map: &mut [f32],
    slopes: &mut [f32],
    starts: ImageStarts,
    size: PlaneSize,
    constants: SimilarityConstants,
    tiles: u32,
    #[comptime] radius: usize,
    #[comptime] kind: SimilarityKind,
    #[comptime] derivatives: Derivatives,
) {
    let mut sums = Shared::<[f32]>::new_slice(comptime!(SUMS * summed(radius)));
    if CUBE_POS < tiles as usize {
        let tile = tile_of(&size);
        let mut item = UNIT_POS;
        while item < comptime!(summed(radius) as u32) {
            let column = column_of(item, &tile, &size, radius);
            if column.is_inside {
                write_moments(a, b, weights, column.pixel, item as usize, &mut sums, &starts, &size, radius);
            }
            item += comptime!(UNITS as u32);
        }
        sync_cube();
        let own = own_pixel(&tile, &size, radius);
        if own.is_inside {
            let moments = moments_along(&sums, weights, &own, &size, radius);
            let trace = if comptime!(kind == SimilarityKind::Ssim) {
                ssim(&moments, &constants)
            } else {
                structure(&moments, &constants)
            };
            let (pixel, pixels) = (own.pixel as usize, (size.planes * size.height * size.width) as usize);
            map[pixel] = trace.value;
            if comptime!(derivatives != Derivatives::None) {
                slopes[pixel] = trace.by_mean_a;
                slopes[pixels + pixel] = trace.by_square;
                slopes[2 * pixels + pixel] = trace.by_cross;
            }
            if comptime!(derivatives == Derivatives::Both) {
                slopes[3 * pixels + pixel] = trace.by_mean_b;
            }
        }
    }
}

/// Writes the moments of two images down the column around a pixel, relative to that pixel. Variances of bright, flat
/// images are therefore not small differences of large numbers.
#[cube]
fn write_moments(
    a: &[f32],
    b: &[f32],
    weights: &[f32],
    pixel: u32,
    item: usize,
    sums: &mut Shared<[f32]>,
    starts: &ImageStarts,
    size: &PlaneSize,
    #[comptime] radius: usize,
) {
    let (first, count, tap) = taps_down(pixel, weights, size);
    let (middle_a, middle_b) = (a[(starts.a + pixel) as usize], b[(starts.b + pixel) as usize]);
    let mut sum_a = 0.0f32;
    let mut sum_b = 0.0f32;
    let mut squares = 0.0f32;
    let mut product = 0.0f32;
    let mut inside = 0.0f32;
    for i in 0..count {
        let at = first + i * size.width;
        let weight = weights[(tap + i) as usize];
        let (from_a, from_b) = (a[(starts.a + at) as usize] - middle_a, b[(starts.b + at) as usize] - middle_b);
        sum_a += weight * from_a;
        sum_b += weight * from_b;
        squares += weight * (from_a * from_a + from_b * from_b);
        product += weight * (from_a * from_b);
        inside += weight;
    }
    let moments = from_middle(sum_a, sum_b, squares, product, inside, middle_a, middle_b);
    sums[item] = moments.mean_a;
    sums[comptime!(summed(radius)) + item] = moments.mean_b;
    sums[comptime!(2 * summed(radius)) + item] = moments.variances;
    sums[comptime!(3 * summed(radius)) + item] = moments.covariance;
}

/// The moments around the unit's pixel from those of the columns, relative to the middle column. A variance is the mean
/// of the columns' variances plus the variance of their means.
#[cube]
fn moments_along(
    sums: &Shared<[f32]>,
    weights: &[f32],
    own: &Place,
    size: &PlaneSize,
    #[comptime] radius: usize,
) -> Moments {
    let (before, count, tap) = taps_along(own.pixel, weights, size);
    let first = (own.item - before) as usize;
    let (middle_a, middle_b) = (sums[own.item as usize], sums[comptime!(summed(radius)) + own.item as usize]);
    let mut sum_a = 0.0f32;
    let mut sum_b = 0.0f32;
    let mut squares = 0.0f32;
    let mut product = 0.0f32;
    let mut inside = 0.0f32;
    for i in 0..count {
        let at = first + i as usize;
        let weight = weights[(tap + i) as usize];
        let (from_a, from_b) = (sums[at] - middle_a, sums[comptime!(summed(radius)) + at] - middle_b);
        sum_a += weight * from_a;
        sum_b += weight * from_b;
        squares += weight * (sums[comptime!(2 * summed(radius)) + at] + (from_a * from_a + from_b * from_b));
        product += weight * (sums[comptime!(3 * summed(radius)) + at] + from_a * from_b);
        inside += weight;
    }
    from_middle(sum_a, sum_b, squares, product, inside, middle_a, middle_b)
}

/// The adjoints of the images, from the cotangent of the map and the slopes that [`similarity()`] saved. `v_b` is written
/// if the adjoints of `both` are wanted.
#[cube(launch_unchecked)]
pub fn similarity_adjoint(
    v_map: &[f32],
    slopes: &[f32],
    a: &[f32],
    b: &[f32],
    weights: &[f32],
    v_a: &mut [f32],
    v_b: &mut [f32],
    starts: ImageStarts,
    size: PlaneSize,
    tiles: u32,
    #[comptime] radius: usize,
    #[comptime] both: bool,
) {
    let maps = comptime!(if both { Derivatives::Both } else { Derivatives::First }.maps());
    let mut sums = Shared::<[f32]>::new_slice(comptime!(maps * summed(radius)));
    if CUBE_POS < tiles as usize {
        let tile = tile_of(&size);
        let pixels = (size.planes * size.height * size.width) as usize;
        let mut item = UNIT_POS;
        while item < comptime!(summed(radius) as u32) {
            let column = column_of(item, &tile, &size, radius);
            if column.is_inside {
                let (first, count, tap) = taps_down(column.pixel, weights, &size);
                let mut down = Array::<f32>::new(maps);
                #[unroll]
                for map in 0..maps {
                    down[map] = 0.0f32;
                }
                for i in 0..count {
                    let at = first + i * size.width;
                    let v = weights[(tap + i) as usize] * v_map[(starts.v_map + at) as usize];
                    #[unroll]
                    for map in 0..maps {
                        down[map] += v * slopes[map * pixels + at as usize];
                    }
                }
                #[unroll]
                for map in 0..maps {
                    sums[comptime!(map * summed(radius)) + item as usize] = down[map];
                }
            }
            item += comptime!(UNITS as u32);
        }
        sync_cube();
        let own = own_pixel(&tile, &size, radius);
        if own.is_inside {
            let (before, count, tap) = taps_along(own.pixel, weights, &size);
            let (pixel, first) = (own.pixel as usize, own.item - before);
            let mut along = Array::<f32>::new(maps);
            #[unroll]
            for map in 0..maps {
                along[map] = 0.0f32;
            }
            for i in 0..count {
                let weight = weights[(tap + i) as usize];
                #[unroll]
                for map in 0..maps {
                    along[map] += weight * sums[comptime!(map * summed(radius)) + (first + i) as usize];
                }
            }
            let (v_mean_a, v_square, v_cross) = (along[0], 2.0f32 * along[1], along[2]);
            let (own_a, own_b) = (a[starts.a as usize + pixel], b[starts.b as usize + pixel]);
            v_a[pixel] = v_mean_a + own_a * v_square + own_b * v_cross;
            if comptime!(both) {
                v_b[pixel] = along[3] + own_b * v_square + own_a * v_cross;
            }
        }
    }
}

/// Columns that are summed for a tile: its own and those beside it.
const fn columns(radius: usize) -> usize {
    TILE[0] + 2 * radius
}

/// Sums of one kind for a tile.
const fn summed(radius: usize) -> usize {
    columns(radius) * TILE[1]
}

/// The cube's tile.
#[derive(CubeType, Clone, Copy)]
struct Tile {
    plane: u32,
    left: u32,
    top: u32,
}

#[cube]
fn tile_of(size: &PlaneSize) -> Tile {
    let (across, down) = comptime!((TILE[0] as u32, TILE[1] as u32));
    let along = (size.width + across - 1u32) / across;
    let each = along * ((size.height + down - 1u32) / down);
    let own = CUBE_POS as u32 % each;
    Tile { plane: CUBE_POS as u32 / each, left: own % along * across, top: own / along * down }
}

/// A pixel, and which of the tile's sums are those around it.
#[derive(CubeType, Clone, Copy)]
struct Place {
    is_inside: bool,
    pixel: u32,
    item: u32,
}

/// The pixel around which the sums of an item are taken.
#[cube]
fn column_of(item: u32, tile: &Tile, size: &PlaneSize, #[comptime] radius: usize) -> Place {
    let columns = comptime!(columns(radius) as u32);
    // Wraps before the first column, and is then not inside.
    let column = tile.left + item % columns - comptime!(radius as u32);
    let row = tile.top + item / columns;
    Place {
        is_inside: column < size.width && row < size.height,
        pixel: (tile.plane * size.height + row) * size.width + column,
        item,
    }
}

/// The unit's own pixel.
#[cube]
fn own_pixel(tile: &Tile, size: &PlaneSize, #[comptime] radius: usize) -> Place {
    let across = comptime!(TILE[0] as u32);
    let item = UNIT_POS / across * comptime!(columns(radius) as u32) + UNIT_POS % across + comptime!(radius as u32);
    column_of(item, tile, size, radius)
}

/// The windowed moments of two images: mean a, mean b, variance of a + variance of b, covariance.
#[derive(CubeType, Clone, Copy)]
struct Moments {
    mean_a: f32,
    mean_b: f32,
    variances: f32,
    covariance: f32,
}

/// Moments from sums that are relative to the middle and include the weights `inside` the image; pixels outside are
/// black.
#[cube]
fn from_middle(
    sum_a: f32,
    sum_b: f32,
    squares: f32,
    product: f32,
    inside: f32,
    middle_a: f32,
    middle_b: f32,
) -> Moments {
    let outside = 1.0f32 - inside;
    let sum_a = sum_a - outside * middle_a;
    let sum_b = sum_b - outside * middle_b;
    let squares = squares + outside * (middle_a * middle_a + middle_b * middle_b);
    let product = product + outside * (middle_a * middle_b);
    Moments {
        mean_a: middle_a + sum_a,
        mean_b: middle_b + sum_b,
        variances: squares - (sum_a * sum_a + sum_b * sum_b),
        covariance: product - sum_a * sum_b,
    }
}

/// A similarity and its derivatives.
#[derive(CubeType, Clone, Copy)]
struct Trace {
    value: f32,
    by_mean_a: f32,
    by_mean_b: f32,
    by_square: f32,
    by_cross: f32,
}

#[cube]
fn ssim(moments: &Moments, constants: &SimilarityConstants) -> Trace {
    let (mean_a, mean_b) = (moments.mean_a, moments.mean_b);
    let squared_means = mean_a * mean_a + mean_b * mean_b;
    let luminance = 2.0f32 * mean_a * mean_b + constants.c1;
    let contrast = 2.0f32 * moments.covariance + constants.c2;
    let means = squared_means + constants.c1;
    let variances = max(moments.variances, 0.0f32) + constants.c2;
    let inverse = 1.0f32 / (means * variances);
    let value = luminance * contrast * inverse;
    let (by_means, by_variances) = (value * variances * inverse, value * means * inverse);
    let through_other = 2.0f32 * (contrast - luminance) * inverse;
    let through_own = 2.0f32 * (by_variances - by_means);
    Trace {
        value,
        by_mean_a: mean_b * through_other + mean_a * through_own,
        by_mean_b: mean_a * through_other + mean_b * through_own,
        by_square: -by_variances,
        by_cross: 2.0f32 * luminance * inverse,
    }
}

#[cube]
fn structure(moments: &Moments, constants: &SimilarityConstants) -> Trace {
    let (mean_a, mean_b) = (moments.mean_a, moments.mean_b);
    let covariance = moments.covariance + constants.c3;
    let variances = max(moments.variances, 0.0f32) + constants.c3;
    let inverse = 1.0f32 / variances.sqrt();
    let value = covariance * inverse;
    let clipped = clamp(value, 0.0f32, constants.structure_max);
    let open = select(value == clipped, inverse, 0.0f32);
    let by_variances = value * inverse * open;
    Trace {
        value: clipped,
        by_mean_a: mean_a * by_variances - mean_b * open,
        by_mean_b: mean_b * by_variances - mean_a * open,
        by_square: -0.5f32 * by_variances,
        by_cross: open,
    }
}
