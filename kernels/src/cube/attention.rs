//! Attention of a few queries per row over a few keys of the same row. CPU twin: `attention/cpu.rs`. Forward, a unit is
//! one head of one query. Backward, it is one head of one row, because all queries of a row add to the same keys.

use cubecl::prelude::*;

/// Attends from `queries` `[N, count, width]` to `memory` `[N, keys, 2 width]` (each key, then its value). `found` has
/// the shape of `queries`.
#[cube(launch)]
pub fn attention(
    queries: &[f32],
    memory: &[f32],
    found: &mut [f32],
    rows: u32,
    width: u32,
    #[comptime] heads: usize,
    #[comptime] count: usize,
    #[comptime] keys: usize,
) {
    let unit = ABSOLUTE_POS;
    if unit < rows as usize * count * heads {
        let (query, part) = (unit / heads, unit % heads);
        let head = head_of(query, query / count, part, width, heads, keys);
        let weights = weigh(queries, memory, &head, keys);
        for column in 0..head.depth {
            let mut sum = 0.0f32;
            #[unroll]
            for key in 0..keys {
                sum += weights[key] * memory[value_at(&head, key) + column];
            }
            found[head.query + column] = sum;
        }
    }
}

/// The adjoints of queries and memory for the cotangent `v_found`, which has the shape of `queries`.
#[cube(launch)]
pub fn attention_backward(
    queries: &[f32],
    memory: &[f32],
    v_found: &[f32],
    v_queries: &mut [f32],
    v_memory: &mut [f32],
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
            let head = head_of(row * count + query, row, part, width, heads, keys);
            let weights = weigh(queries, memory, &head, keys);
            let mut v_weights = Array::<f32>::new(keys);
            let mut mean = 0.0f32;
            #[unroll]
            for key in 0..keys {
                let mut sum = 0.0f32;
                for column in 0..head.depth {
                    let v = v_found[head.query + column];
                    let value = value_at(&head, key) + column;
                    sum += v * memory[value];
                    let mut before = 0.0f32;
                    if query > 0 {
                        before = v_memory[value];
                    }
                    v_memory[value] = before + weights[key] * v;
                }
                v_weights[key] = sum;
                mean += weights[key] * sum;
            }
            #[unroll]
            for key in 0..keys {
                v_weights[key] = weights[key] * (v_weights[key] - mean) * head.scale;
            }
            for column in 0..head.depth {
                let own = queries[head.query + column];
                let mut sum = 0.0f32;
                #[unroll]
                for key in 0..keys {
                    let at = key_at(&head, key) + column;
                    sum += v_weights[key] * memory[at];
                    let mut before = 0.0f32;
                    if query > 0 {
                        before = v_memory[at];
                    }
                    v_memory[at] = before + v_weights[key] * own;
                }
                v_queries[head.query + column] = sum;
            }
        }
    }
}

/// The position of a unit's head.
#[derive(CubeType, Clone, Copy)]
struct Head {
    /// Index of its first value in the queries.
    query: usize,
    /// Index of its first key in the memory.
    first: usize,
    /// Distance from one key or value to the next.
    width: usize,
    /// Length of a query, a key or a value.
    depth: usize,
    /// Factor of the scores.
    scale: f32,
}

#[cube]
fn head_of(
    query: usize,
    row: usize,
    part: usize,
    width: u32,
    #[comptime] heads: usize,
    #[comptime] keys: usize,
) -> Head {
    let width = width as usize;
    let depth = width / heads;
    Head {
        query: query * width + part * depth,
        first: row * keys * 2 * width + part * depth,
        width,
        depth,
        scale: 1.0f32 / f32::cast_from(depth as u32).sqrt(),
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

/// The softmax of the scores.
#[cube]
fn weigh(queries: &[f32], memory: &[f32], head: &Head, #[comptime] keys: usize) -> Array<f32> {
    let mut weights = Array::<f32>::new(keys);
    let mut largest = f32::new(f32::MIN);
    #[unroll]
    for key in 0..keys {
        let mut score = 0.0f32;
        for column in 0..head.depth {
            score += queries[head.query + column] * memory[key_at(head, key) + column];
        }
        weights[key] = score * head.scale;
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
