//! CPU twin of the HexPlane look-up. Points are shared out to threads in the forward pass and for their own adjoints,
//! planes for theirs, so that every sum has one order. Features are worked on in blocks that fill a vector register;
//! each step reads its blocks, then stores its results whole: from such stores the compiler builds vector instructions.
#![allow(clippy::needless_range_loop, reason = "lane loops over several arrays become vector instructions as they are")]

use std::array;

use rayon::prelude::*;

use super::layout::{PAIRS, TIME};
use super::{GridBounds, GridLayout, PlaneLayout};
use crate::Real;
use crate::simd::vectorised;

/// Points that a thread takes at a time.
const POINTS_PER_TASK: usize = 256;

/// Points whose sample adjoints are held at once: few enough to stay in cache between the two halves of the backward.
const POINTS_PER_CHUNK: usize = 4096;

/// Cells of the space-filling curve along each axis: about those of the finest planes.
const CURVE_CELLS: usize = 256;

/// Features in a block.
const LANES: usize = 8;

/// Runs `$body` for blocks of [`LANES`], then for single features, from `$at` on; `$L` is the block's size.
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

/// Where and when features are asked for.
pub(super) struct Query<'a, T> {
    points: &'a [T],
    times: &'a [T],
    max: [T; 3],
    /// The slope of a grid coordinate with respect to a world coordinate.
    slope: [T; 3],
}

impl<'a, T: Real> Query<'a, T> {
    pub(super) fn new(points: &'a [T], times: &'a [T], bounds: &GridBounds) -> Self {
        let slope = |axis: usize| {
            let slope = 2.0 / (bounds.min[axis] - bounds.max[axis]);
            if slope.is_finite() { slope } else { 0.0 }
        };
        Self { points, times, max: bounds.max.map(T::of), slope: array::from_fn(|axis| T::of(slope(axis))) }
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
            coordinates[axis] = (world[axis] - self.max[axis]) * self.slope[axis] - T::one();
        }
        coordinates
    }

    /// The wanted points along a space-filling curve: neighbours in order are neighbours in the planes, so that most
    /// cells are still in cache. Points of one place keep their order.
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

/// A coordinate among the cells of an axis.
#[derive(Clone, Copy, Default)]
struct Place<T> {
    low: usize,
    /// How far on the upper cell is: 1, or 0 on an axis of one cell.
    step: usize,
    fraction: T,
    /// The slope of the cell coordinate with respect to the grid coordinate: 0 on and beyond the border.
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
    /// The first number of the cells (low, low), (low, high), (high, low), (high, high) of (row, column).
    at: [usize; 4],
    column: T,
    row: T,
}

impl<T: Real> Corners<T> {
    /// `first` is the first number of the plane's first cell.
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

/// The `L` numbers from `at` on.
#[inline(always)]
fn block<T, const L: usize>(numbers: &[T], at: usize) -> &[T; L] {
    // Proof: the slice taken has exactly that length.
    numbers[at..at + L].try_into().expect("a slice of that length")
}

/// The same to change.
#[inline(always)]
fn block_mut<T, const L: usize>(numbers: &mut [T], at: usize) -> &mut [T; L] {
    // Proof: as in `block`.
    (&mut numbers[at..at + L]).try_into().expect("a slice of that length")
}

/// The places of a point along the four axes of every scale, then its corners in the scale's six planes.
#[inline(always)]
fn locate<T: Real>(coordinates: [T; 4], axes: [usize; 4]) -> [Place<T>; 4] {
    let mut places = [Place::default(); 4];
    for axis in 0..4 {
        places[axis] = Place::new(coordinates[axis], axes[axis]);
    }
    places
}

/// The scales' axes, beside their planes.
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

/// The adjoints of a look-up's arguments, in their shapes.
pub(super) struct Adjoint<T> {
    pub(super) planes: Vec<T>,
    pub(super) points: Vec<T>,
    pub(super) times: Vec<T>,
}

/// The adjoints for the cotangent `v_features` `[N, scales * F]`. Points without a cotangent (those that no picture
/// shows) cost nothing.
pub(super) fn look_up_backward<T: Real>(
    planes: &[T],
    query: &Query<T>,
    v_features: &[T],
    layout: &GridLayout,
) -> Adjoint<T> {
    let scales = Scales::new(layout);
    let (count, row) = (query.len(), layout.feature_count());
    let mut v_planes = vec![T::zero(); planes.len()];
    let mut v_points = vec![T::zero(); 3 * count];
    let mut v_times = vec![T::zero(); count];
    let points = query.along_curve(|point| v_features[point * row..][..row].iter().any(|v| !v.is_zero()));
    let mut v_samples = vec![T::zero(); 6 * row * points.len().min(POINTS_PER_CHUNK)];
    let mut targets = split_planes(&mut v_planes, &scales);
    for points in points.chunks(POINTS_PER_CHUNK) {
        let v_samples = &mut v_samples[..6 * row * points.len()];
        let v_coordinates = point_adjoints(planes, query, points, v_features, &scales, v_samples);
        for (&point, v_coordinates) in points.iter().zip(v_coordinates) {
            for axis in 0..3 {
                v_points[3 * point + axis] = v_coordinates[axis] * query.slope[axis];
            }
            v_times[point] = v_coordinates[TIME];
        }
        targets.par_iter_mut().with_max_len(1).enumerate().for_each(|(index, v_plane)| {
            add_plane_adjoint(query, points, v_samples, &scales, index, v_plane);
        });
    }
    if query.times.len() == 1 && count != 1 {
        v_times = vec![T::of(v_times.iter().map(|v_time| v_time.wide()).sum())];
    }
    Adjoint { planes: v_planes, points: v_points, times: v_times }
}

/// Each plane's part of the planes' adjoint.
fn split_planes<'a, T>(mut v_planes: &'a mut [T], scales: &Scales) -> Vec<&'a mut [T]> {
    let part = |plane: &PlaneLayout| {
        let (part, rest) = std::mem::take(&mut v_planes).split_at_mut(plane.cells() * scales.features);
        v_planes = rest;
        part
    };
    scales.planes.iter().map(part).collect()
}

/// The adjoints of the grid coordinates of `points`; writes those of their samples, task by task.
fn point_adjoints<T: Real>(
    planes: &[T],
    query: &Query<T>,
    points: &[usize],
    v_features: &[T],
    scales: &Scales,
    v_samples: &mut [T],
) -> Vec<[T; 4]> {
    let (row, samples) = (scales.features * scales.axes.len(), scales.features * scales.planes.len());
    let mut v_coordinates = vec![[T::zero(); 4]; points.len()];
    let tasks = points.par_chunks(POINTS_PER_TASK).zip(v_samples.par_chunks_mut(samples * POINTS_PER_TASK));
    tasks.zip(v_coordinates.par_chunks_mut(POINTS_PER_TASK)).for_each_init(
        || Samples::new(scales.features),
        |buffer, ((points, v_samples), v_coordinates)| {
            vectorised(
                #[inline(always)]
                || {
                    let mut v_samples = TaskSamples { values: &mut *v_samples, points: points.len() };
                    for (index, (&point, v_coordinates)) in points.iter().zip(v_coordinates.iter_mut()).enumerate() {
                        let v_features = &v_features[point * row..][..row];
                        let coordinates = query.grid_coordinates(point);
                        let target = (&mut v_samples, index);
                        *v_coordinates = point_adjoint(planes, coordinates, v_features, scales, buffer, target);
                    }
                },
            );
        },
    );
    v_coordinates
}

/// The samples of one point in the six planes of a scale, `[6, F]` each.
struct Samples<T> {
    value: Vec<T>,
    /// The slopes with respect to the cell coordinates.
    by_column: Vec<T>,
    by_row: Vec<T>,
    /// The adjoints of the values.
    v_value: Vec<T>,
    /// A running product, `[F]`.
    product: Vec<T>,
}

impl<T: Real> Samples<T> {
    fn new(features: usize) -> Self {
        let zeros = || vec![T::zero(); 6 * features];
        let product = vec![T::zero(); features];
        Self { value: zeros(), by_column: zeros(), by_row: zeros(), v_value: zeros(), product }
    }

    #[inline(always)]
    fn take(&mut self, planes: &[T], places: &[Place<T>; 4], layouts: &[PlaneLayout], features: usize) {
        for layout in layouts {
            let corners = Corners::new(places, layout, layout.first_cell * features, features);
            let (column, row) = (corners.column, corners.row);
            in_blocks!(features, at, L => {
                let [a, b, c, d] = corners.cells::<L>(planes, at);
                let at = layout.pair * features + at;
                let [mut value, mut by_column, mut by_row] = [[T::zero(); L]; 3];
                for l in 0..L {
                    let (above, below) = (b[l] - a[l], d[l] - c[l]);
                    let (top, bottom) = (a[l] + above * column, c[l] + below * column);
                    by_column[l] = above + (below - above) * row;
                    by_row[l] = bottom - top;
                    value[l] = top + (bottom - top) * row;
                }
                *block_mut(&mut self.value, at) = value;
                *block_mut(&mut self.by_column, at) = by_column;
                *block_mut(&mut self.by_row, at) = by_row;
            });
        }
    }

    /// The adjoints of the values, of which the features are the product: the cotangent times the other five.
    #[inline(always)]
    fn backward(&mut self, v_product: &[T]) {
        let features = v_product.len();
        self.product.copy_from_slice(v_product);
        for (value, v_value) in self.value.chunks(features).zip(self.v_value.chunks_mut(features)) {
            in_blocks!(features, at, L => {
                let (value, before) = (block::<T, L>(value, at), block_mut::<T, L>(&mut self.product, at));
                *block_mut(v_value, at) = *before;
                let mut next = *before;
                for l in 0..L {
                    next[l] *= value[l];
                }
                *before = next;
            });
        }
        self.product.fill(T::one());
        for (value, v_value) in self.value.chunks(features).zip(self.v_value.chunks_mut(features)).rev() {
            in_blocks!(features, at, L => {
                let (value, after) = (block::<T, L>(value, at), block_mut::<T, L>(&mut self.product, at));
                let v_value = block_mut::<T, L>(v_value, at);
                let (mut v_next, mut next) = (*v_value, *after);
                for l in 0..L {
                    v_next[l] *= next[l];
                    next[l] *= value[l];
                }
                (*v_value, *after) = (v_next, next);
            });
        }
    }
}

/// The sample adjoints of a task's points, `[planes, points, F]`: each plane reads its own in one run.
struct TaskSamples<'a, T> {
    values: &'a mut [T],
    points: usize,
}

/// The adjoint of a point's grid coordinates; writes those of its samples at `index` among the task's points.
#[inline(always)]
fn point_adjoint<T: Real>(
    planes: &[T],
    coordinates: [T; 4],
    v_features: &[T],
    scales: &Scales,
    samples: &mut Samples<T>,
    (v_samples, index): (&mut TaskSamples<T>, usize),
) -> [T; 4] {
    let features = scales.features;
    // Lane by lane, for sums along a block would have to be made in order.
    let mut v_coordinates = [[T::zero(); LANES]; 4];
    for (scale, ((axes, layouts), v_features)) in scales.iter().zip(v_features.chunks(features)).enumerate() {
        let places = locate(coordinates, axes);
        samples.take(planes, &places, layouts, features);
        samples.backward(v_features);
        for pair in 0..6 {
            let out = ((6 * scale + pair) * v_samples.points + index) * features;
            in_blocks!(features, at, L => {
                *block_mut::<T, L>(v_samples.values, out + at) = *block(&samples.v_value, pair * features + at);
            });
            for (axis, slopes) in PAIRS[pair].into_iter().zip([&samples.by_column, &samples.by_row]) {
                let (sums, slope) = (&mut v_coordinates[axis], places[axis].slope);
                in_blocks!(features, at, L => {
                    let at = pair * features + at;
                    let (v_value, slopes) = (block::<T, L>(&samples.v_value, at), block::<T, L>(slopes, at));
                    let sums = block_mut::<T, L>(sums, 0);
                    let mut next = *sums;
                    for l in 0..L {
                        next[l] += v_value[l] * slopes[l] * slope;
                    }
                    *sums = next;
                });
            }
        }
    }
    let mut sums = [T::zero(); 4];
    for axis in 0..4 {
        for lane in v_coordinates[axis] {
            sums[axis] += lane;
        }
    }
    sums
}

/// Adds the sample adjoints of `points` to the cells of plane `index`, point by point.
fn add_plane_adjoint<T: Real>(
    query: &Query<T>,
    points: &[usize],
    v_samples: &[T],
    scales: &Scales,
    index: usize,
    v_plane: &mut [T],
) {
    let (features, plane) = (scales.features, &scales.planes[index]);
    let samples = features * scales.planes.len();
    let axes = scales.axes[plane.scale];
    vectorised(
        #[inline(always)]
        || {
            let tasks = points.chunks(POINTS_PER_TASK).zip(v_samples.chunks(samples * POINTS_PER_TASK));
            for (points, v_samples) in tasks {
                let run = points.len() * features;
                let v_samples = v_samples[index * run..][..run].chunks_exact(features);
                for (&point, v_sample) in points.iter().zip(v_samples) {
                    let places = locate(query.grid_coordinates(point), axes);
                    Corners::new(&places, plane, 0, features).add(v_sample, v_plane);
                }
            }
        },
    );
}
