//! CPU twin of the grid penalties, row by row. Each row has its own sums, and rows are added in order.

use rayon::prelude::*;

use crate::Real;
use crate::grid::{GridLayout, PlaneLayout};
use crate::simd::vectorised;

/// Number of parallel partial sums, in registers; sums are in double precision.
const LANES: usize = 16;

/// Minimum number of rows per task.
const MIN_ROWS: usize = 8;

/// One row of cells of a plane.
struct Row<'a> {
    plane: &'a PlaneLayout,
    row: usize,
}

impl<'a> Row<'a> {
    /// All rows of all planes, in memory order.
    fn all(planes: &'a [PlaneLayout]) -> Vec<Self> {
        planes.iter().flat_map(|plane| (0..plane.height).map(move |row| Self { plane, row })).collect()
    }

    /// The values of the row `offset` below this one; `None` if it is outside the plane.
    #[inline(always)]
    fn values<'v, T>(&self, values: &'v [T], features: usize, offset: isize) -> Option<&'v [T]> {
        let row = self.row.checked_add_signed(offset).filter(|&row| row < self.plane.height)?;
        let length = self.plane.width * features;
        Some(&values[self.plane.first_cell * features + row * length..][..length])
    }
}

/// The divisors of each term's sum over a plane: the number of second differences, and the number of values.
fn counts(plane: &PlaneLayout, features: usize) -> [f64; 2] {
    let row = (plane.width * features) as f64;
    [row * plane.height.saturating_sub(2).max(1) as f64, row * plane.height as f64]
}

/// The terms in this order: plane smoothness, time smoothness, distance of the time planes from 1.
pub(super) fn penalties<T: Real>(planes: &[T], layout: &GridLayout) -> [f64; 3] {
    let layouts = layout.planes();
    let rows = Row::all(&layouts);
    let sums: Vec<[f64; 2]> = rows
        .par_iter()
        .with_min_len(MIN_ROWS)
        .map(|row| {
            vectorised(
                #[inline(always)]
                || row_sums(planes, row, layout.features),
            )
        })
        .collect();
    let mut terms = [0.0; 3];
    let mut rest = sums.as_slice();
    for plane in &layouts {
        let (own, others) = rest.split_at(plane.height);
        rest = others;
        let [differences, numbers] = counts(plane, layout.features);
        let smooth = own.iter().map(|sums| sums[0]).sum::<f64>() / differences;
        terms[usize::from(plane.is_time())] += smooth;
        terms[2] += own.iter().map(|sums| sums[1]).sum::<f64>() / numbers;
    }
    terms
}

/// The sums over a row of the squared second differences that start in it, and of `|1 - p|` in a time plane.
#[inline(always)]
fn row_sums<T: Real>(planes: &[T], row: &Row, features: usize) -> [f64; 2] {
    let values = |offset| row.values(planes, features, offset);
    let smooth = match (values(0), values(1), values(2)) {
        (Some(a), Some(b), Some(c)) => lane_sum(a.len(), |i| {
            let difference = second_difference(a[i], b[i], c[i]);
            difference * difference
        }),
        _ => 0.0,
    };
    let distance = match values(0) {
        Some(a) if row.plane.is_time() => lane_sum(a.len(), |i| (T::one() - a[i]).abs()),
        _ => 0.0,
    };
    [smooth, distance]
}

/// `c - 2 b + a` as the difference of two differences. Those of nearly equal values are exact, whereas a sum of values
/// near 1, where the time planes start, is rounded.
#[inline(always)]
fn second_difference<T: Real>(a: T, b: T, c: T) -> T {
    (c - b) - (b - a)
}

/// The sum of `term` over `0..count`.
#[inline(always)]
fn lane_sum<T: Real>(count: usize, term: impl Fn(usize) -> T) -> f64 {
    let mut lanes = [0.0; LANES];
    let whole = count - count % LANES;
    for start in (0..whole).step_by(LANES) {
        for (lane, sum) in lanes.iter_mut().enumerate() {
            *sum += term(start + lane).wide();
        }
    }
    lanes.into_iter().sum::<f64>() + (whole..count).map(|i| term(i).wide()).sum::<f64>()
}

/// The adjoint of the planes.
pub(super) fn penalties_backward<T: Real>(planes: &[T], v_terms: [T; 3], layout: &GridLayout) -> Vec<T> {
    let layouts = layout.planes();
    let rows = Row::all(&layouts);
    let mut v_planes = vec![T::zero(); planes.len()];
    let mut rest = v_planes.as_mut_slice();
    let mut targets = Vec::with_capacity(rows.len());
    for row in rows {
        let (target, others) = rest.split_at_mut(row.plane.width * layout.features);
        targets.push((row, target));
        rest = others;
    }
    targets.into_par_iter().with_min_len(MIN_ROWS).for_each(|(row, v_row)| {
        vectorised(
            #[inline(always)]
            || row_adjoint(planes, &row, v_terms, layout.features, v_row),
        );
    });
    v_planes
}

/// The adjoint of one row, which is the first, the middle and the last row of up to three second differences.
#[inline(always)]
fn row_adjoint<T: Real>(planes: &[T], row: &Row, v_terms: [T; 3], features: usize, v_row: &mut [T]) {
    let [differences, numbers] = counts(row.plane, features);
    let smooth = v_terms[usize::from(row.plane.is_time())] * T::of(2.0 / differences);
    for (first, share) in [(-2, smooth), (-1, smooth * T::of(-2.0)), (0, smooth)] {
        let values = |offset| row.values(planes, features, offset);
        if let (Some(a), Some(b), Some(c)) = (values(first), values(first + 1), values(first + 2)) {
            for (((v, &a), &b), &c) in v_row.iter_mut().zip(a).zip(b).zip(c) {
                *v += share * second_difference(a, b, c);
            }
        }
    }
    if row.plane.is_time()
        && let Some(values) = row.values(planes, features, 0)
    {
        let distance = v_terms[2] * T::of(1.0 / numbers);
        for (v, &value) in v_row.iter_mut().zip(values) {
            let sign = if value > T::one() { T::one() } else { -T::one() };
            *v += if value == T::one() { T::zero() } else { sign * distance };
        }
    }
}
