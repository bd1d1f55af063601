//! The backward pass of the CPU twin: first the adjoints of points and samples, then the adjoints of the planes.
#![allow(clippy::needless_range_loop, reason = "lane loops over several arrays become vector instructions as they are")]

use rayon::prelude::*;

use super::{Corners, LANES, POINTS_PER_TASK, Place, Query, Scales, block, block_mut, locate};
use crate::Real;
use crate::grid::{GridLayout, PlaneLayout};
use crate::simd::vectorised;
use mvfusion_kernels::grid::{PAIRS, TIME};

/// Points whose sample adjoints are stored at once: few enough to stay in the cache between the two halves.
const POINTS_PER_CHUNK: usize = 4096;

/// The adjoints of the arguments, in their shapes.
pub(in crate::grid) struct Adjoint<T> {
    pub(in crate::grid) planes: Vec<T>,
    pub(in crate::grid) points: Vec<T>,
    pub(in crate::grid) times: Vec<T>,
}

/// The adjoints for the cotangent `v_features` `[N, scales * F]`. Points with a zero cotangent, which no image shows,
/// cost nothing.
pub(in crate::grid) fn look_up_backward<T: Real>(
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

/// Returns the adjoints of the grid coordinates of `points` and writes the adjoints of their samples, task by task.
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
    /// The derivatives with respect to the cell coordinates.
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
                    // Slopes are differences of cells. Those of interpolated values would lose digits near 1, where the
                    // time planes start.
                    let (above, left) = (b[l] - a[l], c[l] - a[l]);
                    let twist = (d[l] - c[l]) - above;
                    by_column[l] = above + twist * row;
                    by_row[l] = left + twist * column;
                    value[l] = a[l] + above * column + by_row[l] * row;
                }
                *block_mut(&mut self.value, at) = value;
                *block_mut(&mut self.by_column, at) = by_column;
                *block_mut(&mut self.by_row, at) = by_row;
            });
        }
    }

    /// The adjoints of the six values whose product is the features: the cotangent times the other five.
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

/// The sample adjoints of a task's points, `[planes, points, F]`, contiguous for each plane.
struct TaskSamples<'a, T> {
    values: &'a mut [T],
    points: usize,
}

/// Returns the adjoint of a point's grid coordinates and writes the adjoints of its samples at `index` among the task's
/// points.
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
    // One sum per lane, because a sum along a block could not be vectorised in its order.
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
