//! CPU twin of the HexPlane interpolation. Threads divide the points in the forward pass and for the adjoints of
//! points, and the planes for the adjoints of planes. Every sum therefore has a fixed order. Features are processed in
//! blocks that fill a vector register. Each step reads its blocks and then stores whole results, so that the compiler
//! generates vector instructions.
#![allow(clippy::needless_range_loop, reason = "lane loops over several arrays become vector instructions as they are")]

use std::array;

use rayon::prelude::*;

use super::{GridBounds, GridLayout, PlaneLayout};
use crate::Real;
use crate::simd::vectorised;
use mvfusion_kernels::grid::PAIRS;

/// Points per task.
const POINTS_PER_TASK: usize = 256;

/// Cells of the space-filling curve along each axis: about as many as in the finest planes.
const CURVE_CELLS: usize = 256;

/// Features in a block.
const LANES: usize = 8;

/// Runs `$body` for blocks of [`LANES`] features, then for single features. `$at` is the block's start, `$L` its size.
macro_rules! in_blocks {
    ($features:expr, $at:ident, $L:ident => $body:expr) => {{
        let mut $at = 0;
        in_blocks!(@ LANES, $features, $at, $L => $body);
        in_blocks!(@ 1, $features, $at, $L => $body);
    }};
    (@ $size:expr, $features:expr, $at:ident, $L:ident => $body:expr) => {
        while $features - $at >= $size {
            const $L: usize = $size;
            $body;
            $at += $size;
        }
    };
}

mod backward;

pub(super) use backward::look_up_backward;

/// The derivatives of grid coordinates with respect to world coordinates.
pub(crate) fn slopes(bounds: &GridBounds) -> [f64; 3] {
    array::from_fn(|axis| {
        let slope = 2.0 / (bounds.min[axis] - bounds.max[axis]);
        if slope.is_finite() { slope } else { 0.0 }
    })
}

/// The lower end of the box along each axis. Points up to there have the grid coordinate 1. Computed from [`slopes`], the
/// coordinate of the end itself may be rounded to less than 1, and a point on the border would have a slope.
pub(crate) fn lower_ends(bounds: &GridBounds) -> [f64; 3] {
    let slopes = slopes(bounds);
    // A box without extent has no inside, whatever its end.
    array::from_fn(|axis| if slopes[axis] < 0.0 { bounds.min[axis] } else { f64::from(f32::MIN) })
}

/// The points and times of an interpolation.
pub(super) struct Query<'a, T> {
    points: &'a [T],
    times: &'a [T],
    max: [T; 3],
    min: [T; 3],
    /// Derivative of a grid coordinate with respect to a world coordinate.
    slope: [T; 3],
}

impl<'a, T: Real> Query<'a, T> {
    pub(super) fn new(points: &'a [T], times: &'a [T], bounds: &GridBounds) -> Self {
        let [max, min, slope] = [bounds.max, lower_ends(bounds), slopes(bounds)].map(|triple| triple.map(T::of));
        Self { points, times, max, min, slope }
    }

    fn len(&self) -> usize {
        self.points.len() / 3
    }

    /// The grid coordinates of a point, `-1..=1` within the grid, and its time.
    #[inline(always)]
    fn grid_coordinates(&self, point: usize) -> [T; 4] {
        let time = if self.times.len() == 1 { self.times[0] } else { self.times[point] };
        let world = &self.points[3 * point..3 * point + 3];
        let mut coordinates = [T::zero(), T::zero(), T::zero(), time];
        for axis in 0..3 {
            let inside = (world[axis] - self.max[axis]) * self.slope[axis] - T::one();
            coordinates[axis] = if world[axis] <= self.min[axis] { T::one() } else { inside };
        }
        coordinates
    }

    /// The wanted points along a space-filling curve. Consecutive points are close in the planes, so that most cells
    /// are in the cache. Points in the same cell keep their order.
    fn along_curve(&self, wanted: impl Fn(usize) -> bool + Sync) -> Vec<usize> {
        let key = |point: usize| {
            let [x, y, z, _] = self.grid_coordinates(point);
            let bits = |coordinate: T| spread_bits(Place::new(coordinate, CURVE_CELLS).low as u64);
            (bits(x) | bits(y) << 1 | bits(z) << 2, point)
        };
        let points = (0..self.len()).into_par_iter().filter(|&point| wanted(point));
        let mut keys: Vec<(u64, usize)> = points.map(key).collect();
        keys.par_sort_unstable();
        keys.into_iter().map(|(_, point)| point).collect()
    }
}

/// The low 10 bits of a number, with two zeros before each.
fn spread_bits(number: u64) -> u64 {
    (0..10).map(|bit| (number >> bit & 1) << (3 * bit)).sum()
}

/// The position of a coordinate among the cells of an axis.
#[derive(Clone, Copy, Default)]
struct Place<T> {
    low: usize,
    /// Distance to the upper cell: 1, or 0 on an axis of one cell.
    step: usize,
    fraction: T,
    /// Derivative of the cell coordinate with respect to the grid coordinate: 0 on and beyond the border.
    slope: T,
}

impl<T: Real> Place<T> {
    #[inline(always)]
    fn new(grid_coordinate: T, cells: usize) -> Self {
        let last = T::of_index(cells - 1);
        let half = T::of(0.5);
        // A NaN becomes 0 in `max`.
        let cell = ((grid_coordinate + T::one()) * half * last).max(T::zero()).min(last);
        let low = cell.trunc_index().min(cells.saturating_sub(2));
        let inside = cell > T::zero() && cell < last;
        let slope = if inside { half * last } else { T::zero() };
        Self { low, step: usize::from(cells > 1), fraction: cell - T::of_index(low), slope }
    }
}

/// The four cells around a point in one plane.
#[derive(Clone, Copy, Default)]
struct Corners<T> {
    /// Index of the first value of the cells (low, low), (low, high), (high, low), (high, high) in (row, column).
    at: [usize; 4],
    column: T,
    row: T,
}

impl<T: Real> Corners<T> {
    /// `first` is the index of the first value of the plane's first cell.
    #[inline(always)]
    fn new(places: &[Place<T>; 4], plane: &PlaneLayout, first: usize, features: usize) -> Self {
        let (column, row) = (&places[PAIRS[plane.pair][0]], &places[PAIRS[plane.pair][1]]);
        let low = first + (row.low * plane.width + column.low) * features;
        let (right, down) = (column.step * features, row.step * plane.width * features);
        Self { at: [low, low + right, low + down, low + down + right], column: column.fraction, row: row.fraction }
    }

    #[inline(always)]
    fn weights(&self) -> [T; 4] {
        let (left, top) = (T::one() - self.column, T::one() - self.row);
        [left * top, self.column * top, left * self.row, self.column * self.row]
    }

    /// Adds the sample's adjoint to the cells.
    #[inline(always)]
    fn add(&self, v_sample: &[T], v_plane: &mut [T]) {
        let weights = self.weights();
        in_blocks!(v_sample.len(), at, L => {
            let v_sample = block::<T, L>(v_sample, at);
            for corner in 0..4 {
                let v_cell = block_mut::<T, L>(v_plane, self.at[corner] + at);
                let mut next = *v_cell;
                for l in 0..L {
                    next[l] += weights[corner] * v_sample[l];
                }
                *v_cell = next;
            }
        });
    }

    #[inline(always)]
    fn cells<'a, const L: usize>(&self, planes: &'a [T], feature: usize) -> [&'a [T; L]; 4] {
        let [a, b, c, d] = self.at;
        [block(planes, a + feature), block(planes, b + feature), block(planes, c + feature), block(planes, d + feature)]
    }
}

/// The `L` values from `at` on.
#[inline(always)]
fn block<T, const L: usize>(numbers: &[T], at: usize) -> &[T; L] {
    // Proof: the slice has exactly that length.
    numbers[at..at + L].try_into().expect("a slice of that length")
}

/// The `L` values from `at` on, mutable.
#[inline(always)]
fn block_mut<T, const L: usize>(numbers: &mut [T], at: usize) -> &mut [T; L] {
    // Proof: as in `block`.
    (&mut numbers[at..at + L]).try_into().expect("a slice of that length")
}

/// The positions of a point along the four axes of a scale.
#[inline(always)]
fn locate<T: Real>(coordinates: [T; 4], axes: [usize; 4]) -> [Place<T>; 4] {
    let mut places = [Place::default(); 4];
    for axis in 0..4 {
        places[axis] = Place::new(coordinates[axis], axes[axis]);
    }
    places
}

/// The axes and planes of all scales.
struct Scales {
    axes: Vec<[usize; 4]>,
    planes: Vec<PlaneLayout>,
    features: usize,
}

impl Scales {
    fn new(layout: &GridLayout) -> Self {
        let axes = (0..layout.multipliers.len()).map(|scale| layout.axes(scale)).collect();
        Self { axes, planes: layout.planes(), features: layout.features }
    }

    fn iter(&self) -> impl Iterator<Item = ([usize; 4], &[PlaneLayout])> {
        self.axes.iter().copied().zip(self.planes.chunks(6))
    }
}

/// The features `[N, scales * F]`.
pub(super) fn look_up<T: Real>(planes: &[T], query: &Query<T>, layout: &GridLayout) -> Vec<T> {
    let scales = Scales::new(layout);
    let row = layout.feature_count();
    let mut features = vec![T::one(); query.len() * row];
    let mut rows: Vec<_> = features.chunks_mut(row).map(Some).collect();
    let ordered = query.along_curve(|_| true).into_iter();
    let mut ordered: Vec<_> = ordered.filter_map(|point| Some((point, rows[point].take()?))).collect();
    ordered.par_chunks_mut(POINTS_PER_TASK).for_each(|points| {
        vectorised(
            #[inline(always)]
            || {
                for (point, features) in points.iter_mut() {
                    look_up_point(planes, query.grid_coordinates(*point), &scales, features);
                }
            },
        );
    });
    features
}

/// Multiplies `features`, all ones, by the samples of their planes.
#[inline(always)]
fn look_up_point<T: Real>(planes: &[T], coordinates: [T; 4], scales: &Scales, features: &mut [T]) {
    for ((axes, layouts), features) in scales.iter().zip(features.chunks_mut(scales.features)) {
        let places = locate(coordinates, axes);
        for layout in layouts {
            let corners = Corners::new(&places, layout, layout.first_cell * scales.features, scales.features);
            let weights = corners.weights();
            in_blocks!(scales.features, at, L => {
                let ([a, b, c, d], product) = (corners.cells::<L>(planes, at), block_mut::<T, L>(features, at));
                let mut next = *product;
                for l in 0..L {
                    next[l] *= a[l] * weights[0] + b[l] * weights[1] + c[l] * weights[2] + d[l] * weights[3];
                }
                *product = next;
            });
        }
    }
}
