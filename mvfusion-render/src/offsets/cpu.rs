//! CPU twins of the sums with offsets.

use std::ops::Range;

use rayon::prelude::*;

use crate::Real;

/// Fewest rows per task.
const BLOCK: usize = 1024;

/// Where an attribute's offsets are in the matrix.
#[derive(Clone, Debug)]
pub(super) struct Place {
    /// Rows.
    pub rows: Range<usize>,
    /// First column.
    pub column: usize,
    /// Columns of the attribute.
    pub width: usize,
}

/// The sums of an attribute and its offsets, in a matrix with so many columns.
pub(super) fn add<T: Real>(attribute: &[T], offsets: &[T], columns: usize, place: &Place) -> Vec<T> {
    let Place { rows, column, width } = place.clone();
    let mut sums = vec![T::zero(); attribute.len()];
    if width == 0 {
        return sums;
    }
    let offsets = offsets[rows.start * columns..rows.end * columns].par_chunks_exact(columns);
    let rows = sums.par_chunks_exact_mut(width).zip(attribute.par_chunks_exact(width)).zip(offsets);
    rows.with_min_len(BLOCK).for_each(|((sums, attribute), offsets)| {
        for ((sum, &value), &offset) in sums.iter_mut().zip(attribute).zip(&offsets[column..]) {
            *sum = value + offset;
        }
    });
    sums
}

/// Writes the cotangents of an attribute's sums into the adjoint of the offsets.
pub(super) fn put<T: Real>(v_sums: &[T], v_offsets: &mut [T], columns: usize, place: &Place) {
    let Place { rows, column, width } = place.clone();
    if width == 0 {
        return;
    }
    let v_offsets = v_offsets[rows.start * columns..rows.end * columns].par_chunks_exact_mut(columns);
    v_offsets.zip(v_sums.par_chunks_exact(width)).with_min_len(BLOCK).for_each(|(v_offsets, v_sums)| {
        v_offsets[column..column + width].copy_from_slice(v_sums);
    });
}
