//! Gradient records of a tile's Gaussians from the tile's sums. CPU twin: `splat/cpu/moments.rs`.
//!
//! The sums are moments 1, x, y, x², xy, y² about the middle of the tile. They become gradients of centre and
//! whitened covariance here, once per record.

use cubecl::prelude::*;

use super::backward_kind::{
    BlendBackwardKind, MIDDLE, POWERS, SUM_CHANNELS, SUM_ONE, SUM_X, SUM_XX, record_numbers, record_vectors,
};
use super::maths::constant;
use super::stage::{FOUR, Four, four_of, head_at};
use crate::splat::gradient_record;

/// Writes the records of a batch of `count` Gaussians, which starts at `first` in the concatenated lists. A unit is a
/// Gaussian.
#[cube]
pub(super) fn write_records(
    staged: &Shared<[Four]>,
    totals: &Shared<[Four]>,
    count: u32,
    first: u32,
    gradients: &mut [Four],
    #[comptime] kind: BlendBackwardKind,
) {
    let mut k = UNIT_POS;
    while k < count {
        let to = (first + k) as usize * comptime!(record_vectors(kind.share.channels));
        write_record(staged, totals, k as usize, gradients, to, kind);
        k += comptime!(kind.share.units() as u32);
    }
}

/// Computes the record of Gaussian `k` of a batch from its totals. Moments about the tile's middle become moments about
/// the centre; see `Moments::gradient` of the twin.
#[cube]
fn write_record(
    staged: &Shared<[Four]>,
    totals: &Shared<[Four]>,
    k: usize,
    gradients: &mut [Four],
    to: usize,
    #[comptime] kind: BlendBackwardKind,
) {
    let head = head_at(staged, k * comptime!(kind.share.vectors()));
    let middle = constant(MIDDLE);
    let (slope, opacity) = (head.slope, head.opacity);
    let (curve_x, curve_y) = (2.0f32 * head.half_x, 2.0f32 * head.half_y);
    let middle_y = head.y + middle;
    let middle_u = head.x + middle + slope * middle_y;
    let one = total(totals, k, SUM_ONE, 0usize, kind);
    let (x, y) = (total(totals, k, SUM_X, 0usize, kind), total(totals, k, SUM_ONE, 1usize, kind));
    let xx = total(totals, k, SUM_XX, 0usize, kind);
    let xy = total(totals, k, SUM_X, 1usize, kind);
    let yy = total(totals, k, SUM_ONE, 2usize, kind);
    // Sums of u, dy, u², u dy and dy².
    let u = x + slope * y + middle_u * one;
    let dy = y + middle_y * one;
    let uu = xx + slope * (2.0f32 * xy + slope * yy) + middle_u * (2.0f32 * (x + slope * y) + middle_u * one);
    let u_dy = xy + slope * yy + middle_u * y + middle_y * u;
    let dy_dy = yy + middle_y * (2.0f32 * y + middle_y * one);

    let mut numbers = Array::<f32>::new(comptime!(record_numbers(kind.share.channels)));
    numbers[gradient_record::CENTRE_X] = opacity * curve_x * u;
    numbers[gradient_record::CENTRE_Y] = opacity * (slope * curve_x * u + curve_y * dy);
    numbers[gradient_record::WHITENED_XX] = 0.5f32 * opacity * curve_x * uu;
    numbers[gradient_record::WHITENED_XY] = opacity * curve_x.sqrt() * curve_y.sqrt() * u_dy;
    numbers[gradient_record::WHITENED_YY] = 0.5f32 * opacity * curve_y * dy_dy;
    numbers[gradient_record::OPACITY] = one;
    numbers[gradient_record::STATISTIC_X] = 0.0f32;
    numbers[gradient_record::STATISTIC_Y] = 0.0f32;
    if comptime!(kind.statistic.is_some()) {
        let (counted_one, counted_x) = comptime!((kind.counted_one(), kind.counted_x()));
        let one = total(totals, k, counted_one, 0usize, kind);
        let (x, y) = (total(totals, k, counted_x, 0usize, kind), total(totals, k, counted_one, 1usize, kind));
        let u = x + slope * y + middle_u * one;
        let dy = y + middle_y * one;
        numbers[gradient_record::STATISTIC_X] = opacity * curve_x * u;
        numbers[gradient_record::STATISTIC_Y] = opacity * (slope * curve_x * u + curve_y * dy);
    }
    #[unroll]
    for channel in 0..comptime!(record_numbers(kind.share.channels) - gradient_record::CHANNELS) {
        let place = comptime!(gradient_record::CHANNELS + channel);
        if comptime!(channel < kind.share.channels) {
            numbers[place] = total(totals, k, comptime!(SUM_CHANNELS + channel), 0usize, kind);
        } else {
            numbers[place] = 0.0f32;
        }
    }
    #[unroll]
    for vector in 0..comptime!(record_vectors(kind.share.channels)) {
        gradients[to + vector] = four_of(&numbers, vector);
    }
}

/// Value `number` of Gaussian `k`, summed over the tile, times y to the given power.
#[cube]
fn total(
    totals: &Shared<[Four]>,
    k: usize,
    #[comptime] number: usize,
    #[comptime] power: usize,
    #[comptime] kind: BlendBackwardKind,
) -> f32 {
    let (spans, vectors) = comptime!((kind.share.spans(), kind.sums()));
    let mut sum = 0.0f32;
    #[unroll]
    for span in 0..spans {
        let vector = (k * spans + span) * vectors + comptime!(number / FOUR);
        sum += totals[POWERS * vector + power].extract(comptime!(number % FOUR));
    }
    sum
}
