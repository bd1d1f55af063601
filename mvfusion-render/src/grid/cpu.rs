//! CPU twin of the HexPlane look-up. Features are worked on in blocks that fill vector registers; points are shared out
//! to threads in the forward pass and for their own adjoints, planes for theirs, so that every sum has one order.

use std::array;

use pulp::Arch;
use rayon::prelude::*;

use super::layout::{PAIRS, TIME};
use super::{GridBounds, GridLayout, PlaneLayout};
use crate::Real;

/// Points that a thread takes at a time.
const POINTS_PER_TASK: usize = 256;

/// Points whose sample adjoints are held at once: few enough to stay in cache between the two halves of the backward.
const POINTS_PER_CHUNK: usize = 4096;

/// Runs `$body` for blocks of 16, then 4, then single features from `$at` on; `$L` is the block's size.
macro_rules! in_blocks {
    ($features:expr, $at:ident, $L:ident => $body:expr) => {{
        let mut $at = 0;
        in_blocks!(@ 16, $features, $at, $L => $body);
        in_blocks!(@ 4, $features, $at, $L => $body);
        in_blocks!(@ 1, $features, $at, $L => $body);
    }};
    (@ $size:literal, $features:expr, $at:ident, $L:ident => $body:expr) => {
        while $at + $size <= $features {
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
        let space = |axis: usize| (world[axis] - self.max[axis]) * self.slope[axis] - T::one();
        [space(0), space(1), space(2), time]
    }
}

/// A coordinate among the cells of an axis.
#[derive(Clone, Copy)]
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
        let last = T::of((cells - 1) as f64);
        let half = T::of(0.5);
        // A NaN becomes 0 in `max`.
        let cell = ((grid_coordinate + T::one()) * half * last).max(T::zero()).min(last);
        let low = cell.trunc_index().min(cells.saturating_sub(2));
        let inside = cell > T::zero() && cell < last;
        let slope = if inside { half * last } else { T::zero() };
        Self { low, step: usize::from(cells > 1), fraction: cell - T::of(low as f64), slope }
    }
}

/// The four cells around a point in one plane.
#[derive(Clone, Copy)]
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
        let [column, row] = PAIRS[plane.pair].map(|axis| places[axis]);
        let low = first + (row.low * plane.width + column.low) * features;
        let (right, down) = (column.step * features, row.step * plane.width * features);
        Self { at: [low, low + right, low + down, low + down + right], column: column.fraction, row: row.fraction }
    }

    #[inline(always)]
    fn weights(&self) -> [T; 4] {
        let (left, top) = (T::one() - self.column, T::one() - self.row);
        [left * top, self.column * top, left * self.row, self.column * self.row]
    }

    #[inline(always)]
    fn cells<'a, const L: usize>(&self, planes: &'a [T], feature: usize) -> [&'a [T; L]; 4] {
        self.at.map(|at| block(planes, at + feature))
    }
}

/// The `L` numbers from `at` on.
#[inline(always)]
fn block<T, const L: usize>(numbers: &[T], at: usize) -> &[T; L] {
    // Proof: the slice taken has exactly that length.
    numbers[at..at + L].try_into().expect("a slice of that length")
}

/// The places of a point along the four axes of every scale, then its corners in the scale's six planes.
#[inline(always)]
fn locate<T: Real>(coordinates: [T; 4], axes: [usize; 4]) -> [Place<T>; 4] {
    array::from_fn(|axis| Place::new(coordinates[axis], axes[axis]))
}

#[inline(always)]
fn corners_of<T: Real>(places: &[Place<T>; 4], planes: &[PlaneLayout], features: usize) -> [Corners<T>; 6] {
    array::from_fn(|pair| Corners::new(places, &planes[pair], planes[pair].first_cell * features, features))
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
    let mut features = vec![T::zero(); query.len() * row];
    let arch = Arch::new();
    features.par_chunks_mut(row * POINTS_PER_TASK).enumerate().for_each(|(task, features)| {
        arch.dispatch(
            #[inline(always)]
            || {
                for (i, features) in features.chunks_mut(row).enumerate() {
                    look_up_point(planes, query.grid_coordinates(task * POINTS_PER_TASK + i), &scales, features);
                }
            },
        );
    });
    features
}

#[inline(always)]
fn look_up_point<T: Real>(planes: &[T], coordinates: [T; 4], scales: &Scales, features: &mut [T]) {
    for ((axes, layouts), features) in scales.iter().zip(features.chunks_mut(scales.features)) {
        let corners = corners_of(&locate(coordinates, axes), layouts, scales.features);
        in_blocks!(scales.features, at, L => {
            let mut product = [T::one(); L];
            for corners in &corners {
                let ([a, b, c, d], weights) = (corners.cells::<L>(planes, at), corners.weights());
                for l in 0..L {
                    product[l] *= a[l] * weights[0] + b[l] * weights[1] + c[l] * weights[2] + d[l] * weights[3];
                }
            }
            features[at..at + L].copy_from_slice(&product);
        });
    }
}

/// The adjoints of a look-up's arguments, in their shapes.
pub(super) struct Adjoint<T> {
    pub(super) planes: Vec<T>,
    pub(super) points: Vec<T>,
    pub(super) times: Vec<T>,
}

/// The adjoints for the cotangent `v_features` `[N, scales * F]`.
pub(super) fn look_up_backward<T: Real>(
    planes: &[T],
    query: &Query<T>,
    v_features: &[T],
    layout: &GridLayout,
) -> Adjoint<T> {
    let scales = Scales::new(layout);
    let count = query.len();
    let (row, samples) = (layout.feature_count(), 6 * layout.feature_count());
    let mut v_planes = vec![T::zero(); planes.len()];
    let mut v_points = vec![T::zero(); 3 * count];
    let mut v_times = vec![T::zero(); count];
    let mut v_samples = vec![T::zero(); samples * count.min(POINTS_PER_CHUNK)];
    let mut targets = split_planes(&mut v_planes, &scales);
    for first in (0..count).step_by(POINTS_PER_CHUNK) {
        let chunk = first..count.min(first + POINTS_PER_CHUNK);
        let v_features = &v_features[chunk.start * row..chunk.end * row];
        let v_samples = &mut v_samples[..chunk.len() * samples];
        let v_times = &mut v_times[chunk.clone()];
        let v_points = &mut v_points[3 * chunk.start..3 * chunk.end];
        point_adjoints(planes, query, first, v_features, &scales, PointAdjoints { v_samples, v_points, v_times });
        targets.par_iter_mut().with_max_len(1).enumerate().for_each(|(index, v_plane)| {
            add_plane_adjoint(query, first, v_features, v_samples, &scales, index, v_plane);
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

/// What the first half of the backward pass writes for a run of points.
struct PointAdjoints<'a, T> {
    /// `[points, planes, F]`.
    v_samples: &'a mut [T],
    /// `[points, 3]`.
    v_points: &'a mut [T],
    /// `[points]`.
    v_times: &'a mut [T],
}

/// The adjoints of the points from `first` on, and of their samples.
fn point_adjoints<T: Real>(
    planes: &[T],
    query: &Query<T>,
    first: usize,
    v_features: &[T],
    scales: &Scales,
    out: PointAdjoints<T>,
) {
    let (row, samples) = (scales.features * scales.axes.len(), scales.features * scales.planes.len());
    let arch = Arch::new();
    let v_features = v_features.par_chunks(row * POINTS_PER_TASK);
    let v_samples = out.v_samples.par_chunks_mut(samples * POINTS_PER_TASK);
    let v_points = out.v_points.par_chunks_mut(3 * POINTS_PER_TASK);
    let v_times = out.v_times.par_chunks_mut(POINTS_PER_TASK);
    v_features.zip(v_samples).zip(v_points.zip(v_times)).enumerate().for_each(
        |(task, ((v_features, v_samples), (v_points, v_times)))| {
            arch.dispatch(
                #[inline(always)]
                || {
                    let rows = v_features.chunks(row).zip(v_samples.chunks_mut(samples));
                    let rows = rows.zip(v_points.chunks_mut(3).zip(v_times));
                    for (i, ((v_features, v_samples), (v_point, v_time))) in rows.enumerate() {
                        if is_zero(v_features) {
                            continue;
                        }
                        let coordinates = query.grid_coordinates(first + task * POINTS_PER_TASK + i);
                        let v_coordinates = point_adjoint(planes, coordinates, v_features, scales, v_samples);
                        for axis in 0..3 {
                            v_point[axis] = v_coordinates[axis] * query.slope[axis];
                        }
                        *v_time = v_coordinates[TIME];
                    }
                },
            );
        },
    );
}

/// Points without a cotangent (those that no picture shows) leave no trace and cost nothing.
#[inline(always)]
fn is_zero<T: Real>(v_features: &[T]) -> bool {
    v_features.iter().all(|v_feature| v_feature.is_zero())
}

/// The adjoint of a point's grid coordinates; writes those of its samples `[planes, F]`.
#[inline(always)]
fn point_adjoint<T: Real>(
    planes: &[T],
    coordinates: [T; 4],
    v_features: &[T],
    scales: &Scales,
    v_samples: &mut [T],
) -> [T; 4] {
    let features = scales.features;
    let mut v_coordinates = [T::zero(); 4];
    let outputs = v_features.chunks(features).zip(v_samples.chunks_mut(6 * features));
    for ((axes, layouts), (v_features, v_samples)) in scales.iter().zip(outputs) {
        let places = locate(coordinates, axes);
        let corners = corners_of(&places, layouts, features);
        let mut v_cells = [T::zero(); 4];
        in_blocks!(features, at, L => {
            let samples = corners.map(|corners| Sample::<T, L>::new(&corners, planes, at));
            let v_values = v_factors(block(v_features, at), &samples);
            let mut v_axes = [[T::zero(); L]; 4];
            for (pair, [column, row]) in PAIRS.into_iter().enumerate() {
                v_samples[pair * features + at..][..L].copy_from_slice(&v_values[pair]);
                for l in 0..L {
                    v_axes[column][l] += v_values[pair][l] * samples[pair].by_column[l];
                    v_axes[row][l] += v_values[pair][l] * samples[pair].by_row[l];
                }
            }
            for (v_cell, v_axis) in v_cells.iter_mut().zip(v_axes) {
                *v_cell += v_axis.into_iter().sum();
            }
        });
        for axis in 0..4 {
            v_coordinates[axis] += v_cells[axis] * places[axis].slope;
        }
    }
    v_coordinates
}

/// `L` features of a bilinear sample, and their slopes with respect to the cell coordinates.
#[derive(Clone, Copy)]
struct Sample<T, const L: usize> {
    value: [T; L],
    by_column: [T; L],
    by_row: [T; L],
}

impl<T: Real, const L: usize> Sample<T, L> {
    #[inline(always)]
    fn new(corners: &Corners<T>, planes: &[T], feature: usize) -> Self {
        let [a, b, c, d] = corners.cells::<L>(planes, feature);
        let (column, row) = (corners.column, corners.row);
        let mut sample = Self { value: [T::zero(); L], by_column: [T::zero(); L], by_row: [T::zero(); L] };
        for l in 0..L {
            let (above, below) = (b[l] - a[l], d[l] - c[l]);
            let (top, bottom) = (a[l] + above * column, c[l] + below * column);
            sample.by_column[l] = above + (below - above) * row;
            sample.by_row[l] = bottom - top;
            sample.value[l] = top + (bottom - top) * row;
        }
        sample
    }
}

/// The adjoints of the six factors of a product: the cotangent times the other five.
#[inline(always)]
fn v_factors<T: Real, const L: usize>(v_product: &[T; L], samples: &[Sample<T, L>; 6]) -> [[T; L]; 6] {
    let mut v_values = [[T::zero(); L]; 6];
    let mut before = *v_product;
    for (v_value, sample) in v_values.iter_mut().zip(samples) {
        *v_value = before;
        for l in 0..L {
            before[l] *= sample.value[l];
        }
    }
    let mut after = [T::one(); L];
    for (v_value, sample) in v_values.iter_mut().zip(samples).rev() {
        for l in 0..L {
            v_value[l] *= after[l];
            after[l] *= sample.value[l];
        }
    }
    v_values
}

/// Adds the sample adjoints of the points from `first` on to the cells of plane `index`, point by point.
fn add_plane_adjoint<T: Real>(
    query: &Query<T>,
    first: usize,
    v_features: &[T],
    v_samples: &[T],
    scales: &Scales,
    index: usize,
    v_plane: &mut [T],
) {
    let (features, plane) = (scales.features, &scales.planes[index]);
    let (row, samples) = (features * scales.axes.len(), features * scales.planes.len());
    let axes = scales.axes[plane.scale];
    Arch::new().dispatch(
        #[inline(always)]
        || {
            for (i, (v_features, v_samples)) in v_features.chunks(row).zip(v_samples.chunks(samples)).enumerate() {
                if is_zero(v_features) {
                    continue;
                }
                let places = locate(query.grid_coordinates(first + i), axes);
                let corners = Corners::new(&places, plane, 0, features);
                let v_sample = &v_samples[index * features..][..features];
                in_blocks!(features, at, L => {
                    let v_sample: &[T; L] = block(v_sample, at);
                    for (corner, weight) in corners.at.into_iter().zip(corners.weights()) {
                        for (v_cell, &v_sample) in v_plane[corner + at..][..L].iter_mut().zip(v_sample) {
                            *v_cell += weight * v_sample;
                        }
                    }
                });
            }
        },
    );
}
