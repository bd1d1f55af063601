//! From a tile's sums to the gradient records of its Gaussians. CPU twin: `Moments` in `splat/cpu/blend_backward.rs`.
//!
//! What depends on a pixel's place only through 1, x, y, x², xy, y² was summed as these moments about the middle of the
//! tile; here they become gradients of centre and covariance, once a record.

use cubecl::prelude::*;

use super::blend_backward::{BlendBackwardKind, MIDDLE, record_vectors};
use super::maths::constant;
use super::stage::{FOUR, Four, four_of};
use crate::splat::PROJECTED_GRADIENT_LEN;

/// Writes the records of a batch of `count`, which starts at `first` in all lists: a unit is a Gaussian.
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

/// Turns the totals of Gaussian `k` of a batch into its record, the covariance's moments about the tile's middle into
/// those about the centre; see `Moments::gradient` of the twin.
#[cube]
fn write_record(
    staged: &Shared<[Four]>,
    totals: &Shared<[Four]>,
    k: usize,
    gradients: &mut [Four],
    to: usize,
    #[comptime] kind: BlendBackwardKind,
) {
    let at = k * comptime!(kind.share.vectors());
    let (shape, rest) = (staged[at], staged[at + 1]);
    let middle = constant(MIDDLE);
    let slope = shape.extract(3usize);
    let (curve_x, curve_y) = (2.0f32 * shape.extract(2usize), 2.0f32 * rest.extract(0usize));
    let opacity = rest.extract(1usize);
    let middle_y = shape.extract(1usize) + middle;
    let middle_u = shape.extract(0usize) + middle + slope * middle_y;
    let one = total(totals, k, 0usize, 0usize, kind);
    let (x, y) = (total(totals, k, 1usize, 0usize, kind), total(totals, k, 0usize, 1usize, kind));
    let xx = total(totals, k, 2usize, 0usize, kind);
    let xy = total(totals, k, 1usize, 1usize, kind);
    let yy = total(totals, k, 0usize, 2usize, kind);
    // Sums of u, dy, u², u dy and dy².
    let u = x + slope * y + middle_u * one;
    let dy = y + middle_y * one;
    let uu = xx + slope * (2.0f32 * xy + slope * yy) + middle_u * (2.0f32 * (x + slope * y) + middle_u * one);
    let u_dy = xy + slope * yy + middle_u * y + middle_y * u;
    let dy_dy = yy + middle_y * (2.0f32 * y + middle_y * one);
    let (g_xx, g_xu) = (curve_x * curve_x * uu, curve_x * curve_y * u_dy);

    let mut numbers = Array::<f32>::new(comptime!(FOUR * record_vectors(kind.share.channels)));
    numbers[0] = opacity * curve_x * u;
    numbers[1] = opacity * (slope * curve_x * u + curve_y * dy);
    numbers[2] = 0.5f32 * opacity * g_xx;
    numbers[3] = opacity * (slope * g_xx + g_xu);
    numbers[4] = 0.5f32 * opacity * (slope * slope * g_xx + 2.0f32 * slope * g_xu + curve_y * curve_y * dy_dy);
    numbers[5] = one;
    numbers[6] = 0.0f32;
    numbers[7] = 0.0f32;
    if comptime!(kind.statistic.is_some()) {
        let counted = comptime!(3 + kind.share.channels);
        let one = total(totals, k, counted, 0usize, kind);
        let (x, y) = (total(totals, k, comptime!(counted + 1), 0usize, kind), total(totals, k, counted, 1usize, kind));
        let u = x + slope * y + middle_u * one;
        let dy = y + middle_y * one;
        numbers[6] = opacity * curve_x * u;
        numbers[7] = opacity * (slope * curve_x * u + curve_y * dy);
    }
    #[unroll]
    for i in 0..comptime!(FOUR * record_vectors(kind.share.channels) - PROJECTED_GRADIENT_LEN) {
        if comptime!(i < kind.share.channels) {
            numbers[comptime!(PROJECTED_GRADIENT_LEN + i)] = total(totals, k, comptime!(3 + i), 0usize, kind);
        } else {
            numbers[comptime!(PROJECTED_GRADIENT_LEN + i)] = 0.0f32;
        }
    }
    #[unroll]
    for vector in 0..comptime!(record_vectors(kind.share.channels)) {
        gradients[to + vector] = four_of(&numbers, vector);
    }
}

/// Number `number` of Gaussian `k`, summed over the rows times y to the given power.
#[cube]
fn total(
    totals: &Shared<[Four]>,
    k: usize,
    #[comptime] number: usize,
    #[comptime] power: usize,
    #[comptime] kind: BlendBackwardKind,
) -> f32 {
    let vector = k * comptime!(kind.sums()) + comptime!(number / FOUR);
    totals[3 * vector + power].extract(comptime!(number % FOUR))
}
