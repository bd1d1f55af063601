//! Products of small matrices that may be transposed, or columns of a wider matrix: a safe interface to the crate
//! `gemm`.

use std::ops::Range;

use super::add_rows;
use crate::Real;

/// A matrix inside a slice.
#[derive(Clone, Copy)]
pub(super) struct Matrix<'a, T> {
    numbers: &'a [T],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a, T: Real> Matrix<'a, T> {
    /// A whole slice as a matrix with `rows` rows.
    pub(super) fn rows(numbers: &'a [T], rows: usize) -> Self {
        let columns = numbers.len() / rows;
        Self { numbers, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// Some columns of a slice whose rows are `width` wide.
    pub(super) fn columns(numbers: &'a [T], width: usize, columns: Range<usize>) -> Self {
        Self {
            numbers: &numbers[columns.start..],
            rows: numbers.len() / width,
            columns: columns.len(),
            row_stride: width,
            column_stride: 1,
        }
    }

    /// The transpose.
    pub(super) fn turned(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    /// Adds every row to `total`. The matrix must not be transposed.
    pub(super) fn add_rows_to(self, total: &mut [T]) {
        for row in self.numbers.chunks(self.row_stride) {
            add_rows(total, &row[..self.columns]);
        }
    }

    /// Distance from the first value to the end of the last.
    fn span(&self) -> usize {
        span(self.rows, self.columns, self.row_stride, self.column_stride)
    }
}

fn span(rows: usize, columns: usize, row_stride: usize, column_stride: usize) -> usize {
    if rows == 0 || columns == 0 { 0 } else { (rows - 1) * row_stride + (columns - 1) * column_stride + 1 }
}

/// `target += a b`, on this thread. The rows of `target` start `stride` values apart.
pub(super) fn add_product<T: Real>(target: &mut [T], stride: usize, a: Matrix<'_, T>, b: Matrix<'_, T>) {
    assert_eq!(a.columns, b.rows, "the sum runs over the columns of one factor and the rows of the other");
    assert!(span(a.rows, b.columns, stride, 1) <= target.len() && b.columns <= stride, "the target is too small");
    assert!(a.span() <= a.numbers.len() && b.span() <= b.numbers.len(), "a factor is too small");
    // SAFETY: the assertions above keep every access inside the three slices; rows of the target do not overlap, and
    // the target is borrowed exclusively.
    unsafe {
        gemm::gemm(
            a.rows,
            b.columns,
            a.columns,
            target.as_mut_ptr(),
            1,
            stride as isize,
            true,
            a.numbers.as_ptr(),
            a.column_stride as isize,
            a.row_stride as isize,
            b.numbers.as_ptr(),
            b.column_stride as isize,
            b.row_stride as isize,
            T::one(),
            T::one(),
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}
