//! Attention on slices. Rows are independent and run in parallel.

use rayon::prelude::*;

use crate::Real;
use crate::simd::vectorised;

/// Rows per task.
const BLOCK: usize = 64;

/// Partial sums of a scalar product. It is summed in the same order on every machine.
const SUMS: usize = 8;

/// The layout of the rows of queries and memory.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    /// Columns of a query, a key and a value.
    pub width: usize,
    /// Queries per row, which share its keys.
    pub queries: usize,
    /// Keys per row.
    pub keys: usize,
    /// Number of heads, which divide the columns.
    pub heads: usize,
}

/// The adjoints of queries and memory.
pub(super) struct Adjoint<T> {
    pub queries: Vec<T>,
    pub memory: Vec<T>,
}

impl Layout {
    /// Length of a row's queries.
    fn query_numbers(self) -> usize {
        self.queries * self.width
    }

    /// Length of a row of the memory.
    fn memory_numbers(self) -> usize {
        self.keys * 2 * self.width
    }

    /// Columns per head.
    fn depth(self) -> usize {
        self.width / self.heads
    }
}

/// Attends from `queries` `[N, queries, width]` to `memory` `[N, keys, 2 width]`. The result has the shape of
/// `queries`.
pub(super) fn forward<T: Real>(queries: &[T], memory: &[T], layout: Layout) -> Vec<T> {
    let mut found = vec![T::zero(); queries.len()];
    let blocks = (
        found.par_chunks_mut(BLOCK * layout.query_numbers()),
        queries.par_chunks(BLOCK * layout.query_numbers()),
        memory.par_chunks(BLOCK * layout.memory_numbers()),
    );
    blocks.into_par_iter().for_each(|(found, queries, memory)| {
        let mut weights = vec![T::zero(); layout.keys];
        vectorised(
            #[inline(always)]
            || {
                let rows =
                    queries.chunks_exact(layout.query_numbers()).zip(memory.chunks_exact(layout.memory_numbers()));
                for (found, (queries, memory)) in found.chunks_exact_mut(layout.query_numbers()).zip(rows) {
                    let queries = queries.chunks_exact(layout.width);
                    for (found, query) in found.chunks_exact_mut(layout.width).zip(queries) {
                        for head in 0..layout.heads {
                            let head = Head::of(query, memory, layout, head);
                            head.weigh(&mut weights);
                            let found = &mut found[head.first..head.first + layout.depth()];
                            for (key, &weight) in weights.iter().enumerate() {
                                add_scaled(found, head.value(key), weight);
                            }
                        }
                    }
                }
            },
        );
    });
    found
}

/// The adjoints of queries and memory for the cotangent `v_found` `[N, queries, width]`.
pub(super) fn backward<T: Real>(queries: &[T], memory: &[T], v_found: &[T], layout: Layout) -> Adjoint<T> {
    let mut adjoint = Adjoint { queries: vec![T::zero(); queries.len()], memory: vec![T::zero(); memory.len()] };
    let blocks = (
        adjoint.queries.par_chunks_mut(BLOCK * layout.query_numbers()),
        adjoint.memory.par_chunks_mut(BLOCK * layout.memory_numbers()),
        queries.par_chunks(BLOCK * layout.query_numbers()),
        memory.par_chunks(BLOCK * layout.memory_numbers()),
        v_found.par_chunks(BLOCK * layout.query_numbers()),
    );
    blocks.into_par_iter().for_each(|(v_queries, v_memory, queries, memory, v_found)| {
        let mut weights = vec![T::zero(); layout.keys];
        let mut v_weights = vec![T::zero(); layout.keys];
        vectorised(
            #[inline(always)]
            || {
                let memories = memory
                    .chunks_exact(layout.memory_numbers())
                    .zip(v_memory.chunks_exact_mut(layout.memory_numbers()));
                let rows = queries
                    .chunks_exact(layout.query_numbers())
                    .zip(v_queries.chunks_exact_mut(layout.query_numbers()));
                let rows = rows.zip(v_found.chunks_exact(layout.query_numbers()));
                for (((queries, v_queries), v_found), (memory, v_memory)) in rows.zip(memories) {
                    let queries = queries.chunks_exact(layout.width).zip(v_queries.chunks_exact_mut(layout.width));
                    for ((query, v_query), v_found) in queries.zip(v_found.chunks_exact(layout.width)) {
                        for head in 0..layout.heads {
                            let head = Head::of(query, memory, layout, head);
                            let columns = head.first..head.first + layout.depth();
                            head.weigh(&mut weights);
                            let v_query = &mut v_query[columns.clone()];
                            head.pull_back(&weights, &mut v_weights, &v_found[columns], v_query, v_memory);
                        }
                    }
                }
            },
        );
    });
    adjoint
}

/// One head of one query.
struct Head<'a, T> {
    query: &'a [T],
    memory: &'a [T],
    layout: Layout,
    /// First column of the head.
    first: usize,
    /// `1 / sqrt(d)`.
    scale: T,
}

impl<'a, T: Real> Head<'a, T> {
    #[inline(always)]
    fn of(query: &'a [T], memory: &'a [T], layout: Layout, index: usize) -> Self {
        let depth = layout.depth();
        let first = index * depth;
        let scale = T::one() / T::of_index(depth).sqrt();
        Self { query: &query[first..first + depth], memory, layout, first, scale }
    }

    /// The start of key `index` in the row's memory.
    #[inline(always)]
    fn key_at(&self, index: usize) -> usize {
        index * 2 * self.layout.width + self.first
    }

    /// The start of value `index`.
    #[inline(always)]
    fn value_at(&self, index: usize) -> usize {
        self.key_at(index) + self.layout.width
    }

    #[inline(always)]
    fn key(&self, index: usize) -> &'a [T] {
        &self.memory[self.key_at(index)..][..self.query.len()]
    }

    #[inline(always)]
    fn value(&self, index: usize) -> &'a [T] {
        &self.memory[self.value_at(index)..][..self.query.len()]
    }

    /// The softmax of the scores.
    #[inline(always)]
    fn weigh(&self, weights: &mut [T]) {
        let mut largest = T::neg_infinity();
        for (index, weight) in weights.iter_mut().enumerate() {
            *weight = scalar_product(self.query, self.key(index)) * self.scale;
            largest = largest.max(*weight);
        }
        let mut sum = T::zero();
        for weight in weights.iter_mut() {
            *weight = (*weight - largest).exp();
            sum += *weight;
        }
        for weight in weights.iter_mut() {
            *weight = *weight / sum;
        }
    }

    /// Adds the adjoints of this head's query, keys and values; `v_weights` is scratch memory.
    #[inline(always)]
    fn pull_back(&self, weights: &[T], v_weights: &mut [T], v_found: &[T], v_query: &mut [T], v_memory: &mut [T]) {
        let depth = self.query.len();
        let mut mean = T::zero();
        for (index, (v_weight, &weight)) in v_weights.iter_mut().zip(weights).enumerate() {
            *v_weight = scalar_product(v_found, self.value(index));
            mean += weight * *v_weight;
            add_scaled(&mut v_memory[self.value_at(index)..][..depth], v_found, weight);
        }
        for (index, (&v_weight, &weight)) in v_weights.iter().zip(weights).enumerate() {
            let v_score = weight * (v_weight - mean) * self.scale;
            add_scaled(v_query, self.key(index), v_score);
            add_scaled(&mut v_memory[self.key_at(index)..][..depth], self.query, v_score);
        }
    }
}

#[inline(always)]
fn scalar_product<T: Real>(a: &[T], b: &[T]) -> T {
    let (a, rest_a) = a.as_chunks::<SUMS>();
    let (b, rest_b) = b.as_chunks::<SUMS>();
    let mut sums = [T::zero(); SUMS];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..SUMS {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let mut sum = rest_a.iter().zip(rest_b).fold(T::zero(), |sum, (&a, &b)| sum + a * b);
    for part in sums {
        sum += part;
    }
    sum
}

/// `total += numbers * factor`.
#[inline(always)]
fn add_scaled<T: Real>(total: &mut [T], numbers: &[T], factor: T) {
    for (sum, &x) in total.iter_mut().zip(numbers) {
        *sum += x * factor;
    }
}
