//! The MLPs on slices. Blocks of rows stay in the cache and run in parallel.

mod product;

use std::ops::Range;

use rayon::prelude::*;

use self::product::{Matrix, add_product};
use super::MlpLayout;
use super::layout::LinearLayout;
use crate::Real;
use crate::simd::vectorised;

/// Rows that pass through all layers at once. At width 128, a hidden block has 128 KiB, so a few of them and the
/// weights fit into a core's L2 cache.
const BLOCK: usize = 256;

/// Largest number of row ranges with separate sums of parameter gradients. Each needs memory for all parameters.
const MAX_PARTS: usize = 32;

/// Minimum size of such a range, in blocks.
const MIN_PART_BLOCKS: usize = 4;

/// The requested adjoints.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted {
    pub input: bool,
    pub parameters: bool,
}

/// The parameters of a layer.
#[derive(Clone, Copy)]
pub(super) struct Weights<'a, T> {
    /// `[inputs, outputs]`.
    pub weight: &'a [T],
    /// `[outputs]`.
    pub bias: &'a [T],
}

/// The adjoints of the input, and of weight and bias of each layer.
pub(super) struct Adjoint<T> {
    pub input: Option<Vec<T>>,
    pub parameters: Option<Vec<Vec<T>>>,
}

/// Outputs `[N, outputs]` of rows `[N, inputs]`.
pub(super) fn forward<T: Real>(input: &[T], parameters: &[Weights<'_, T>], layout: &MlpLayout) -> Vec<T> {
    let columns = layout.outputs();
    let layers = layout.layers();
    let mut outputs = vec![T::zero(); input.len() / layout.inputs * columns];
    outputs.par_chunks_mut(BLOCK * columns).zip(input.par_chunks(BLOCK * layout.inputs)).for_each(
        |(outputs, input)| {
            let mut block = Block::new(input, layout);
            let mut first = 0;
            for chain in &layers {
                block.pass_hidden_layers(chain, parameters);
                let last = &chain[chain.len() - 1];
                linear(block.source(chain.len() - 1), last, parameters[last.index], outputs, columns, first);
                first += last.outputs;
            }
        },
    );
    outputs
}

/// The adjoints of rows `[N, inputs]` and parameters for the cotangent `v_outputs` `[N, outputs]`.
///
/// Rows are divided in the same way for any number of threads, and parts are summed in order.
pub(super) fn backward<T: Real>(
    input: &[T],
    parameters: &[Weights<'_, T>],
    v_outputs: &[T],
    layout: &MlpLayout,
    wanted: Wanted,
) -> Adjoint<T> {
    let columns = layout.outputs();
    let layers = layout.layers();
    let rows = input.len() / layout.inputs;
    let part = rows.div_ceil(MAX_PARTS).next_multiple_of(BLOCK).max(MIN_PART_BLOCKS * BLOCK);
    let part_rows = |part_index: usize| part_index * part..((part_index + 1) * part).min(rows);

    let pull_back = |part_index: usize, mut v_input: Option<&mut [T]>| -> Vec<T> {
        let mut v_parameters = vec![T::zero(); if wanted.parameters { layout.parameters() } else { 0 }];
        let range = part_rows(part_index);
        for start in range.clone().step_by(BLOCK) {
            let rows = start..(start + BLOCK).min(range.end);
            let of = |rows: &Range<usize>, width: usize| rows.start * width..rows.end * width;
            let mut block = Block::new(&input[of(&rows, layout.inputs)], layout);
            let v_input = v_input.as_deref_mut().map(|v| {
                let local = start - range.start..rows.end - range.start;
                &mut v[of(&local, layout.inputs)]
            });
            block.pull_back(&layers, parameters, &v_outputs[of(&rows, columns)], columns, v_input, &mut v_parameters);
        }
        v_parameters
    };

    let parts = rows.div_ceil(part);
    let (v_input, sums): (Option<Vec<T>>, Vec<Vec<T>>) = if wanted.input {
        let mut v_input = vec![T::zero(); input.len()];
        let pieces = v_input.par_chunks_mut(part * layout.inputs).enumerate();
        let sums = pieces.map(|(index, v_input)| pull_back(index, Some(v_input))).collect();
        (Some(v_input), sums)
    } else {
        (None, (0..parts).into_par_iter().map(|index| pull_back(index, None)).collect())
    };
    Adjoint { input: v_input, parameters: wanted.parameters.then(|| sum_in_order(&sums, &layout.ranges())) }
}

/// The sums of vectors of equal length, first to last, in each of the ranges.
fn sum_in_order<T: Real>(vectors: &[Vec<T>], ranges: &[Range<usize>]) -> Vec<Vec<T>> {
    const PIECE: usize = 4096;
    let mut totals: Vec<Vec<T>> = ranges.iter().map(|range| vec![T::zero(); range.len()]).collect();
    let pieces = totals.iter_mut().zip(ranges).flat_map(|(total, range)| {
        total.chunks_mut(PIECE).enumerate().map(|(index, piece)| (range.start + index * PIECE, piece))
    });
    let pieces: Vec<(usize, &mut [T])> = pieces.collect();
    pieces.into_par_iter().for_each(|(first, piece)| {
        let range = first..first + piece.len();
        vectors.iter().for_each(|vector| add_rows(piece, &vector[range.clone()]));
    });
    totals
}

/// A few rows that pass through the layers.
struct Block<'a, T> {
    /// The input rows.
    input: &'a [T],
    /// The input rows after the ReLU, if there is one.
    rectified: Option<Vec<T>>,
    /// The rectified outputs of all layers of a chain except the last.
    hidden: Vec<Vec<T>>,
    rows: usize,
    inputs: usize,
}

impl<'a, T: Real> Block<'a, T> {
    fn new(input: &'a [T], layout: &MlpLayout) -> Self {
        let rectified = layout.rectified.then(|| {
            let mut rows = input.to_vec();
            rectify(&mut rows);
            rows
        });
        Self { input, rectified, hidden: Vec::new(), rows: input.len() / layout.inputs, inputs: layout.inputs }
    }

    /// The input of layer `index` of the current chain.
    fn source(&self, index: usize) -> Matrix<'_, T> {
        match index.checked_sub(1) {
            Some(before) => Matrix::rows(&self.hidden[before], self.rows),
            None => Matrix::rows(self.rectified.as_deref().unwrap_or(self.input), self.rows),
        }
    }

    /// Fills `hidden` with the outputs of all layers of a chain except the last.
    fn pass_hidden_layers(&mut self, chain: &[LinearLayout], parameters: &[Weights<'_, T>]) {
        for (index, layer) in chain[..chain.len() - 1].iter().enumerate() {
            let mut rows = std::mem::take(self.hidden_mut(index));
            rows.resize(self.rows * layer.outputs, T::zero());
            linear(self.source(index), layer, parameters[layer.index], &mut rows, layer.outputs, 0);
            rectify(&mut rows);
            *self.hidden_mut(index) = rows;
        }
    }

    fn hidden_mut(&mut self, index: usize) -> &mut Vec<T> {
        if self.hidden.len() <= index {
            self.hidden.push(Vec::new());
        }
        &mut self.hidden[index]
    }

    /// Adds the adjoints of the parameters to `v_parameters`, unless it is empty, and writes the adjoints of the input.
    fn pull_back(
        &mut self,
        layers: &[Vec<LinearLayout>],
        parameters: &[Weights<'_, T>],
        v_outputs: &[T],
        columns: usize,
        mut v_input: Option<&mut [T]>,
        v_parameters: &mut [T],
    ) {
        let (mut v_rows, mut v_before) = (Vec::new(), Vec::new());
        let mut first = 0;
        for chain in layers {
            self.pass_hidden_layers(chain, parameters);
            for (index, layer) in chain.iter().enumerate().rev() {
                let v = match index + 1 == chain.len() {
                    true => Matrix::columns(v_outputs, columns, first..first + layer.outputs),
                    false => Matrix::rows(&v_rows, self.rows),
                };
                if !v_parameters.is_empty() {
                    add_product(&mut v_parameters[layer.weight.clone()], layer.outputs, self.source(index).turned(), v);
                    v.add_rows_to(&mut v_parameters[layer.bias.clone()]);
                }
                let weight = Matrix::rows(parameters[layer.index].weight, layer.inputs).turned();
                if index > 0 {
                    v_before.clear();
                    v_before.resize(self.rows * layer.inputs, T::zero());
                    add_product(&mut v_before, layer.inputs, v, weight);
                    keep_positive(&mut v_before, &self.hidden[index - 1]);
                    std::mem::swap(&mut v_rows, &mut v_before);
                } else if let Some(v_input) = &mut v_input {
                    add_product(v_input, self.inputs, v, weight);
                }
            }
            first += chain[chain.len() - 1].outputs;
        }
        if let (Some(v_input), Some(rectified)) = (v_input, &self.rectified) {
            keep_positive(v_input, rectified);
        }
    }
}

/// Writes `source W + b` to the columns of `target` from `first` on; `target` has `columns` columns.
fn linear<T: Real>(
    source: Matrix<'_, T>,
    layer: &LinearLayout,
    parameters: Weights<'_, T>,
    target: &mut [T],
    columns: usize,
    first: usize,
) {
    for row in target.chunks_exact_mut(columns) {
        row[first..first + layer.outputs].copy_from_slice(parameters.bias);
    }
    let weight = Matrix::rows(parameters.weight, layer.inputs);
    add_product(&mut target[first..], columns, source, weight);
}

/// Applies the ReLU. NaN stays, so that it shows.
fn rectify<T: Real>(numbers: &mut [T]) {
    vectorised(
        #[inline(always)]
        || {
            for x in numbers.iter_mut() {
                *x = if *x <= T::zero() { T::zero() } else { *x };
            }
        },
    );
}

/// The adjoint of the ReLU with the result `rectified`.
fn keep_positive<T: Real>(adjoints: &mut [T], rectified: &[T]) {
    vectorised(
        #[inline(always)]
        || {
            for (v, &y) in adjoints.iter_mut().zip(rectified) {
                *v = if y <= T::zero() { T::zero() } else { *v };
            }
        },
    );
}

/// `total += numbers`.
fn add_rows<T: Real>(total: &mut [T], numbers: &[T]) {
    vectorised(
        #[inline(always)]
        || {
            for (sum, &x) in total.iter_mut().zip(numbers) {
                *sum += x;
            }
        },
    );
}
