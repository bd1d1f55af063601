//! HexPlane interpolation and its adjoint. CPU twin: `grid/cpu.rs` and `grid/cpu/backward.rs`.
//!
//! `layout` `[scales, 4 + 6]` has the number of cells along x, y, z and t and the first cell of each plane, for each
//! scale.

use cubecl::prelude::*;

use super::atomic::AtomicSum;
use super::maths::Triple;
use crate::grid::PAIRS;

/// Planes per scale.
const PLANES: usize = PAIRS.len();
/// Axes of space and time.
const AXES: usize = 4;
/// Length of a scale's layout.
pub const SCALE_LAYOUT: usize = AXES + PLANES;

/// The map from world to grid coordinates: `(world - max) * slope - 1`, and 1 up to `min`; see the twin.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct GridBox {
    /// The corner of the largest coordinates.
    pub max: Triple,
    /// The corner of the smallest coordinates.
    pub min: Triple,
    /// Slopes along the axes.
    pub slope: Triple,
}

/// The position of a point along the axes of a scale, one entry per axis.
#[derive(CubeType)]
struct Places {
    /// The cell below.
    low: Array<u32>,
    /// Distance to the cell above: 1, or 0 on an axis of one cell.
    step: Array<u32>,
    /// Fraction of the way from the cell below to the cell above.
    fraction: Array<f32>,
    /// Derivative of the cell coordinate with respect to the grid coordinate: 0 on and beyond the border.
    slope: Array<f32>,
}

/// The four cells around a point in a plane, as indices of their first feature, and the point's position between them.
#[derive(CubeType, Clone, Copy)]
struct Corners {
    low_low: usize,
    low_high: usize,
    high_low: usize,
    high_high: usize,
    column: f32,
    row: f32,
}

/// Interpolates the features `[N, scales * F]` of points `[N, 3]` at `times` `[N]`, or at `times[0]` if `time_step` is
/// 0. A unit computes one feature of one scale of one point.
#[cube(launch_unchecked)]
pub fn look_up(
    planes: &[f32],
    points: &[f32],
    times: &[f32],
    layout: &[u32],
    found: &mut [f32],
    grid: GridBox,
    count: u32,
    scales: u32,
    features: u32,
    time_step: u32,
) {
    let unit = ABSOLUTE_POS;
    let (features, scales) = (features as usize, scales as usize);
    if unit < count as usize * scales * features {
        let feature = unit % features;
        let scale = unit / features % scales;
        let point = unit / features / scales;
        let places = places_of(points, times, layout, &grid, point, scale, time_step);
        let mut product = 1.0f32;
        #[unroll]
        for pair in 0..PLANES {
            let corners = corners_of(&places, layout, scale, features, pair);
            product *= sample(planes, &corners, feature).value;
        }
        found[unit] = product;
    }
}

/// Units that share the features of a point at a scale on a GPU. Neighbouring units then add to neighbouring numbers, and
/// fewer of them to the same one.
pub const GPU_LANES: usize = 16;

/// The adjoints for the cotangent `v_found`. Those of the planes are added to `v_planes`. Those of the grid coordinates
/// are written to `v_places` `[N, scales, lanes, 4]`. A unit processes every `lanes`-th feature of one point at one scale.
#[cube(launch_unchecked)]
pub fn look_up_backward<S: AtomicSum>(
    planes: &[f32],
    points: &[f32],
    times: &[f32],
    layout: &[u32],
    v_found: &[f32],
    v_planes: &[Atomic<S::Cell>],
    v_places: &mut [f32],
    grid: GridBox,
    count: u32,
    scales: u32,
    features: u32,
    lanes: u32,
    time_step: u32,
) {
    let unit = ABSOLUTE_POS;
    let (features, scales, lanes) = (features as usize, scales as usize, lanes as usize);
    if unit < count as usize * scales * lanes {
        let row = unit / lanes;
        let scale = row % scales;
        let point = row / scales;
        let places = places_of(points, times, layout, &grid, point, scale, time_step);
        let mut v_place = Array::<f32>::new(AXES);
        #[unroll]
        for axis in 0..AXES {
            v_place[axis] = 0.0f32;
        }
        let mut feature = unit % lanes;
        while feature < features {
            let v = v_found[row * features + feature];
            // Points that no image shows cost nothing.
            if v != 0.0f32 {
                let mut values = Array::<f32>::new(PLANES);
                let mut by_column = Array::<f32>::new(PLANES);
                let mut by_row = Array::<f32>::new(PLANES);
                #[unroll]
                for pair in 0..PLANES {
                    let corners = corners_of(&places, layout, scale, features, pair);
                    let sample = sample(planes, &corners, feature);
                    values[pair] = sample.value;
                    by_column[pair] = sample.by_column;
                    by_row[pair] = sample.by_row;
                }
                // The cotangent times the other five samples: the prefix product, then the suffix product.
                let mut others = Array::<f32>::new(PLANES);
                let mut before = v;
                #[unroll]
                for pair in 0..PLANES {
                    others[pair] = before;
                    before *= values[pair];
                }
                let mut after = 1.0f32;
                #[unroll]
                for turn in 0..PLANES {
                    let pair = comptime!(PLANES - 1 - turn);
                    let v_sample = others[pair] * after;
                    after *= values[pair];
                    let corners = corners_of(&places, layout, scale, features, pair);
                    let (left, top) = (1.0f32 - corners.column, 1.0f32 - corners.row);
                    S::add(&v_planes[corners.low_low + feature], left * top * v_sample);
                    S::add(&v_planes[corners.low_high + feature], corners.column * top * v_sample);
                    S::add(&v_planes[corners.high_low + feature], left * corners.row * v_sample);
                    S::add(&v_planes[corners.high_high + feature], corners.column * corners.row * v_sample);
                    v_place[comptime!(PAIRS[pair][0])] += v_sample * by_column[pair];
                    v_place[comptime!(PAIRS[pair][1])] += v_sample * by_row[pair];
                }
            }
            feature += lanes;
        }
        #[unroll]
        for axis in 0..AXES {
            v_places[unit * AXES + axis] = v_place[axis] * places.slope[axis];
        }
    }
}

/// Sums the adjoints of the positions over the `parts` of a point, its scales and lanes: `v_points` `[N, 3]` in world
/// coordinates, `v_times` `[N]`.
#[cube(launch)]
pub fn sum_places(v_places: &[f32], v_points: &mut [f32], v_times: &mut [f32], grid: GridBox, count: u32, parts: u32) {
    let point = ABSOLUTE_POS;
    if point < count as usize {
        let mut sums = Array::<f32>::new(AXES);
        #[unroll]
        for axis in 0..AXES {
            sums[axis] = 0.0f32;
        }
        for part in 0..parts as usize {
            #[unroll]
            for axis in 0..AXES {
                sums[axis] += v_places[(point * parts as usize + part) * AXES + axis];
            }
        }
        v_points[3 * point] = sums[0] * grid.slope.x;
        v_points[3 * point + 1] = sums[1] * grid.slope.y;
        v_points[3 * point + 2] = sums[2] * grid.slope.z;
        v_times[point] = sums[3];
    }
}

#[cube]
fn grid_coordinate(world: f32, max: f32, min: f32, slope: f32) -> f32 {
    select(world <= min, 1.0f32, (world - max) * slope - 1.0f32)
}

#[cube]
fn places_of(
    points: &[f32],
    times: &[f32],
    layout: &[u32],
    grid: &GridBox,
    point: usize,
    scale: usize,
    time_step: u32,
) -> Places {
    let mut coordinates = Array::<f32>::new(AXES);
    coordinates[0] = grid_coordinate(points[3 * point], grid.max.x, grid.min.x, grid.slope.x);
    coordinates[1] = grid_coordinate(points[3 * point + 1], grid.max.y, grid.min.y, grid.slope.y);
    coordinates[2] = grid_coordinate(points[3 * point + 2], grid.max.z, grid.min.z, grid.slope.z);
    coordinates[3] = times[point * time_step as usize];
    let mut places = Places {
        low: Array::<u32>::new(AXES),
        step: Array::<u32>::new(AXES),
        fraction: Array::<f32>::new(AXES),
        slope: Array::<f32>::new(AXES),
    };
    #[unroll]
    for axis in 0..AXES {
        let cells = layout[scale * SCALE_LAYOUT + axis];
        let last = f32::cast_from(cells - 1u32);
        let raw = (coordinates[axis] + 1.0f32) * 0.5f32 * last;
        // Written so that NaN becomes 0.
        let cell = select(raw > 0.0f32, min(raw, last), 0.0f32);
        let step = min(cells - 1u32, 1u32);
        let low = min(u32::cast_from(cell), cells - 1u32 - step);
        places.low[axis] = low;
        places.step[axis] = step;
        places.fraction[axis] = cell - f32::cast_from(low);
        places.slope[axis] = select(cell > 0.0f32 && cell < last, 0.5f32 * last, 0.0f32);
    }
    places
}

#[cube]
fn corners_of(places: &Places, layout: &[u32], scale: usize, features: usize, #[comptime] pair: usize) -> Corners {
    let (across, down) = comptime!((PAIRS[pair][0], PAIRS[pair][1]));
    let width = layout[scale * SCALE_LAYOUT + across];
    let first = layout[scale * SCALE_LAYOUT + AXES + pair];
    let cell = (first + places.low[down] * width + places.low[across]) as usize * features;
    let right = places.step[across] as usize * features;
    let below = (places.step[down] * width) as usize * features;
    Corners {
        low_low: cell,
        low_high: cell + right,
        high_low: cell + below,
        high_high: cell + below + right,
        column: places.fraction[across],
        row: places.fraction[down],
    }
}

/// An interpolated feature and its derivatives along a row of cells and across the rows.
#[derive(CubeType, Clone, Copy)]
struct Sample {
    value: f32,
    by_column: f32,
    by_row: f32,
}

#[cube]
fn sample(planes: &[f32], corners: &Corners, feature: usize) -> Sample {
    let (a, b) = (planes[corners.low_low + feature], planes[corners.low_high + feature]);
    let (c, d) = (planes[corners.high_low + feature], planes[corners.high_high + feature]);
    // Slopes are differences of cells; see the twin.
    let (above, left) = (b - a, c - a);
    let twist = (d - c) - above;
    let by_row = left + twist * corners.column;
    Sample { value: a + above * corners.column + by_row * corners.row, by_column: above + twist * corners.row, by_row }
}
