//! Rows of a matrix, one per lane.

#![allow(clippy::needless_range_loop, reason = "both loops run over two arrays, each with its own order of indices")]

use pulp::Simd;

use super::{Lanes, MAX_LANES, Wide};

/// Consecutive rows of row-major matrices, at most one per lane. Lanes beyond the last row repeat it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows {
    /// Index of the first row.
    pub first: usize,
    /// Number of rows, at least one.
    pub count: usize,
}

impl Rows {
    /// The blocks of rows `0..count` with `lanes` rows each; the last may be smaller.
    #[inline(always)]
    pub(crate) fn blocks(count: usize, lanes: usize) -> impl Iterator<Item = Self> {
        (0..count).step_by(lanes).map(move |first| Self { first, count: lanes.min(count - first) })
    }

    /// The same rows of a matrix that has `rows` more rows at its start.
    #[inline(always)]
    pub(crate) fn after(self, rows: usize) -> Self {
        Self { first: self.first + rows, ..self }
    }

    /// Columns `from..from + C` of a matrix with `width` columns.
    #[inline(always)]
    pub(crate) fn load<S: Simd, T: Lanes, const C: usize>(
        self,
        simd: S,
        matrix: &[T],
        width: usize,
        from: usize,
    ) -> [Wide<S, T>; C] {
        let mut block = [[T::zero(); MAX_LANES]; C];
        for lane in 0..Wide::<S, T>::LANES {
            let start = (self.first + lane.min(self.count - 1)) * width + from;
            let row = &matrix[start..start + C];
            for column in 0..C {
                block[column][lane] = row[column];
            }
        }
        let mut columns = [Wide::splat(simd, T::zero()); C];
        for column in 0..C {
            columns[column] = Wide::load(simd, &block[column], 0);
        }
        columns
    }
}

/// Columns as rows, one per lane.
#[inline(always)]
pub(crate) fn to_rows<S: Simd, T: Lanes, const C: usize>(columns: [Wide<S, T>; C]) -> [[T; C]; MAX_LANES] {
    let mut rows = [[T::zero(); C]; MAX_LANES];
    for column in 0..C {
        let lanes = columns[column].to_lanes();
        for lane in 0..Wide::<S, T>::LANES {
            rows[lane][column] = lanes[lane];
        }
    }
    rows
}
