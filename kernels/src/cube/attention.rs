//! Attention of one query a row over a few keys of its own. CPU twin: `attention/cpu.rs`. A unit is one head of one
//! row.

use cubecl::prelude::*;

/// What each of `queries` `[N, width]` finds in `memory` `[N, keys, 2 width]` (keys, then values): `found` `[N,
/// width]`.
#[cube(launch)]
pub fn attention(
    queries: &[f32],
    memory: &[f32],
    found: &mut [f32],
    rows: u32,
    width: u32,
    #[comptime] heads: usize,
    #[comptime] keys: usize,
) {
    let unit = ABSOLUTE_POS;
    let width = width as usize;
    if unit < rows as usize * heads {
        let depth = width / heads;
        let query = unit / heads * width + unit % heads * depth;
        let first = unit / heads * keys * 2 * width + unit % heads * depth;
        let weights = weigh(queries, memory, query, first, width, depth, keys);
        for column in 0..depth {
            let mut sum = 0.0f32;
            #[unroll]
            for key in 0..keys {
                sum += weights[key] * memory[first + comptime!(2 * key + 1) * width + column];
            }
            found[query + column] = sum;
        }
    }
}

/// The adjoints of queries and memory for the cotangent `v_found` `[N, width]`.
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
    #[comptime] keys: usize,
) {
    let unit = ABSOLUTE_POS;
    let width = width as usize;
    if unit < rows as usize * heads {
        let depth = width / heads;
        let query = unit / heads * width + unit % heads * depth;
        let first = unit / heads * keys * 2 * width + unit % heads * depth;
        let weights = weigh(queries, memory, query, first, width, depth, keys);
        let mut v_weights = Array::<f32>::new(keys);
        let mut mean = 0.0f32;
        #[unroll]
        for key in 0..keys {
            let mut sum = 0.0f32;
            for column in 0..depth {
                let v = v_found[query + column];
                let value = first + comptime!(2 * key + 1) * width + column;
                sum += v * memory[value];
                v_memory[value] = weights[key] * v;
            }
            v_weights[key] = sum;
            mean += weights[key] * sum;
        }
        let scale = 1.0f32 / f32::cast_from(depth as u32).sqrt();
        #[unroll]
        for key in 0..keys {
            v_weights[key] = weights[key] * (v_weights[key] - mean) * scale;
        }
        for column in 0..depth {
            let own = queries[query + column];
            let mut sum = 0.0f32;
            #[unroll]
            for key in 0..keys {
                let at = first + comptime!(2 * key) * width + column;
                sum += v_weights[key] * memory[at];
                v_memory[at] = v_weights[key] * own;
            }
            v_queries[query + column] = sum;
        }
    }
}

/// The softmax of the scores.
#[cube]
fn weigh(
    queries: &[f32],
    memory: &[f32],
    query: usize,
    first: usize,
    width: usize,
    depth: usize,
    #[comptime] keys: usize,
) -> Array<f32> {
    let mut weights = Array::<f32>::new(keys);
    let scale = 1.0f32 / f32::cast_from(depth as u32).sqrt();
    let mut largest = f32::new(f32::MIN);
    #[unroll]
    for key in 0..keys {
        let mut score = 0.0f32;
        for column in 0..depth {
            score += queries[query + column] * memory[first + comptime!(2 * key) * width + column];
        }
        weights[key] = score * scale;
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
