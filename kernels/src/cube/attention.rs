//! Attention of a few queries per row over a few keys of the same row. CPU twin: `attention/cpu.rs`. Forward, a unit is
//! one head of one query. Backward, it is one head of one row, because all queries of a row add to the same keys. Numbers
//! are read and written `N` at a time; the length of a head is a multiple of it.

use cubecl::prelude::*;

/// Attends from `queries` `[N, count, width]` to `memory` `[N, keys, 2 width]` (each key, then its value). `found` has
/// the shape of `queries`.
#[cube(launch)]
pub fn attention<N: Size>(
    queries: &[Vector<f32, N>],
    memory: &[Vector<f32, N>],
    found: &mut [Vector<f32, N>],
    rows: u32,
    width: u32,
    #[comptime] heads: usize,
    #[comptime] count: usize,
    #[comptime] keys: usize,
) {
    let unit = ABSOLUTE_POS;
    if unit < rows as usize * count * heads {
        let (query, part) = (unit / heads, unit % heads);
        let head = head_of::<N>(query, query / count, part, width, heads, keys);
        let weights = weigh(queries, memory, &head, keys);
        for column in 0..head.depth {
            let mut sum = Vector::<f32, N>::new(0.0f32);
            #[unroll]
            for key in 0..keys {
                sum += Vector::new(weights[key]) * memory[value_at(&head, key) + column];
            }
            found[head.query + column] = sum;
        }
    }
}

/// The adjoints of queries and memory for the cotangent `v_found`, which has the shape of `queries`.
#[cube(launch)]
pub fn attention_backward<N: Size>(
    queries: &[Vector<f32, N>],
    memory: &[Vector<f32, N>],
    v_found: &[Vector<f32, N>],
    v_queries: &mut [Vector<f32, N>],
    v_memory: &mut [Vector<f32, N>],
    rows: u32,
    width: u32,
    #[comptime] heads: usize,
    #[comptime] count: usize,
    #[comptime] keys: usize,
) {
    let unit = ABSOLUTE_POS;
    if unit < rows as usize * heads {
        let (row, part) = (unit / heads, unit % heads);
        // The first query writes the adjoints of the memory, the others add to them.
        for query in 0..count {
            let head = head_of::<N>(row * count + query, row, part, width, heads, keys);
            let weights = weigh(queries, memory, &head, keys);
            let mut v_weights = Array::<f32>::new(keys);
            let mut mean = 0.0f32;
            #[unroll]
            for key in 0..keys {
                let mut sums = Vector::<f32, N>::new(0.0f32);
                for column in 0..head.depth {
                    let v = v_found[head.query + column];
                    let value = value_at(&head, key) + column;
                    sums += v * memory[value];
                    let mut before = Vector::<f32, N>::new(0.0f32);
                    if query > 0 {
                        before = v_memory[value];
                    }
                    v_memory[value] = before + Vector::new(weights[key]) * v;
                }
                v_weights[key] = sum_of(sums);
                mean += weights[key] * v_weights[key];
            }
            #[unroll]
            for key in 0..keys {
                v_weights[key] = weights[key] * (v_weights[key] - mean) * head.scale;
            }
            for column in 0..head.depth {
                let own = queries[head.query + column];
                let mut sum = Vector::<f32, N>::new(0.0f32);
                #[unroll]
                for key in 0..keys {
                    let at = key_at(&head, key) + column;
                    sum += Vector::new(v_weights[key]) * memory[at];
                    let mut before = Vector::<f32, N>::new(0.0f32);
                    if query > 0 {
                        before = v_memory[at];
                    }
                    v_memory[at] = before + Vector::new(v_weights[key]) * own;
                }
                v_queries[head.query + column] = sum;
            }
        }
    }
}

/// The position of a unit's head, in vectors.
#[derive(CubeType, Clone, Copy)]
struct Head {
    /// Index of its first vector in the queries.
    query: usize,
    /// Index of its first key in the memory.
    first: usize,
    /// Distance from one key or value to the next.
    width: usize,
    /// Vectors of a query, a key or a value.
    depth: usize,
    /// Factor of the scores.
    scale: f32,
}

#[cube]
fn head_of<N: Size>(
    query: usize,
    row: usize,
    part: usize,
    width: u32,
    #[comptime] heads: usize,
    #[comptime] keys: usize,
) -> Head {
    let length = width as usize / heads;
    let (width, depth) = (width as usize / N::value(), length / N::value());
    Head {
        query: query * width + part * depth,
        first: row * keys * 2 * width + part * depth,
        width,
        depth,
        scale: 1.0f32 / f32::cast_from(length as u32).sqrt(),
    }
}

#[cube]
fn key_at(head: &Head, #[comptime] key: usize) -> usize {
    head.first + comptime!(2 * key) * head.width
}

#[cube]
fn value_at(head: &Head, #[comptime] key: usize) -> usize {
    head.first + comptime!(2 * key + 1) * head.width
}

/// The sum of a vector's numbers.
#[cube]
fn sum_of<N: Size>(vector: Vector<f32, N>) -> f32 {
    let mut sum = vector.extract(0usize);
    #[unroll]
    for part in 1..N::value() {
        sum += vector.extract(part);
    }
    sum
}

/// The softmax of the scores.
#[cube]
fn weigh<N: Size>(
    queries: &[Vector<f32, N>],
    memory: &[Vector<f32, N>],
    head: &Head,
    #[comptime] keys: usize,
) -> Array<f32> {
    let mut weights = Array::<f32>::new(keys);
    let mut largest = f32::new(f32::MIN);
    #[unroll]
    for key in 0..keys {
        let mut score = Vector::<f32, N>::new(0.0f32);
        for column in 0..head.depth {
            score += queries[head.query + column] * memory[key_at(head, key) + column];
        }
        weights[key] = sum_of(score) * head.scale;
        largest = max(largest, weights[key]);
    }
    let mut sum = 0.0f32;
    #[unroll]
    for key in 0..keys {
        weights[key] = (weights[key] - largest).exp();
        sum += weights[key];
    }
    #[unroll]
    for key in 0..keys {
        weights[key] /= sum;
    }
    weights
}
