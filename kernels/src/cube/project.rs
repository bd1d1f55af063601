//! Projection of Gaussians to ellipses on the image plane. CPU twin: `splat/cpu/project.rs`.

use cubecl::prelude::*;

use super::geometry::{Geometry, compensation, geometry_of};
use super::maths::{Triple, constant, is_finite, scaled, sigmoid, sum, triple_at};
use super::sh;
use super::tiles::{Splat, count_tiles, tile_rectangle};
use super::view::{ProjectionKind, View};
use crate::splat::{MAX_RADIUS, MIN_ALPHA, MIN_EIGENVALUE_SPREAD, PROJECTED_LEN, REACH_SLACK, projected_row};

/// Projects each Gaussian: `records` `[N, PROJECTED_LEN]`, `radii` `[N, 2]`, `largest` `[N]` of both radii, and
/// `touched` `[N]`, the number of tiles. All are 0 for a culled Gaussian.
#[cube(launch)]
pub fn project(
    means: &[f32],
    quaternions: &[f32],
    log_scales: &[f32],
    opacity_logits: &[f32],
    coefficients: &[f32],
    features: &[f32],
    records: &mut [f32],
    radii: &mut [i32],
    largest: &mut [i32],
    touched: &mut [u32],
    view: View,
    count: u32,
    stored: u32,
    feature_count: u32,
    #[comptime] kind: ProjectionKind,
) {
    let index = ABSOLUTE_POS;
    if index < count as usize {
        let geometry = geometry_of(means, quaternions, log_scales, index, &view);
        let (radius_x, radius_y) = radii_of(&geometry, &view, kind.square);
        let logit = opacity_logits[index];
        let opacity = sigmoid(logit) * compensation(&geometry, kind.compensated);
        let (unit, _) = direction(means, index, &view);
        let colour = sh::colour(&unit, coefficients, index * stored as usize, kind.degree);
        let covariance = &geometry.covariance;
        let splat = Splat {
            centre: geometry.centre,
            curve_x: covariance.z / geometry.determinant,
            slope: -covariance.y / covariance.z,
            curve_y: 1.0f32 / covariance.z,
            opacity,
            reach: (opacity * constant(1.0 / MIN_ALPHA)).ln() + constant(REACH_SLACK),
            depth: geometry.point.z,
        };
        let mut visible = geometry.valid
            && radius_x > 0
            && is_finite(logit)
            && is_finite(geometry.determinant)
            && is_finite(covariance.x)
            && is_finite(splat.centre.x)
            && is_finite(splat.centre.y)
            && is_finite(splat.curve_x)
            && is_finite(splat.slope)
            && is_finite(splat.curve_y)
            && is_finite(colour.x)
            && is_finite(colour.y)
            && is_finite(colour.z);
        for feature in 0..feature_count {
            visible = visible && is_finite(features[index * feature_count as usize + feature as usize]);
        }
        let rectangle = tile_rectangle(&splat.centre, radius_x, radius_y, &view, kind.square);
        visible = visible && rectangle.left < rectangle.right && rectangle.top < rectangle.bottom;

        let first = index * PROJECTED_LEN;
        if visible {
            records[first + projected_row::CENTRE_X] = splat.centre.x;
            records[first + projected_row::CENTRE_Y] = splat.centre.y;
            records[first + projected_row::CURVE_X] = splat.curve_x;
            records[first + projected_row::SLOPE] = splat.slope;
            records[first + projected_row::CURVE_Y] = splat.curve_y;
            records[first + projected_row::OPACITY] = splat.opacity;
            records[first + projected_row::REACH] = splat.reach;
            records[first + projected_row::DEPTH] = splat.depth;
            records[first + projected_row::RED] = max(colour.x, 0.0f32);
            records[first + projected_row::GREEN] = max(colour.y, 0.0f32);
            records[first + projected_row::BLUE] = max(colour.z, 0.0f32);
            radii[2 * index] = radius_x;
            radii[2 * index + 1] = radius_y;
            largest[index] = max(radius_x, radius_y);
            let mut tiles = 0u32;
            if splat.reach > 0.0f32 {
                tiles = count_tiles(&splat, &rectangle);
            }
            touched[index] = tiles;
        } else {
            #[unroll]
            for field in 0..PROJECTED_LEN {
                records[first + field] = 0.0f32;
            }
            radii[2 * index] = 0;
            radii[2 * index + 1] = 0;
            largest[index] = 0;
            touched[index] = 0u32;
        }
    }
}

/// Unit direction from the camera's centre to a Gaussian, and their distance.
#[cube]
pub fn direction(means: &[f32], index: usize, view: &View) -> (Triple, f32) {
    let offset = sum(&triple_at(means, index), &scaled(&view.centre, -1.0f32));
    let distance = (offset.x * offset.x + offset.y * offset.y + offset.z * offset.z).sqrt();
    (scaled(&offset, 1.0f32 / distance), distance)
}

/// Half sides of the rectangle that the Gaussian covers, in whole pixels.
#[cube]
fn radii_of(geometry: &Geometry, view: &View, #[comptime] square: bool) -> (i32, i32) {
    let covariance = &geometry.covariance;
    let (xx, xy, yy) = (covariance.x, covariance.y, covariance.z);
    if comptime!(square) {
        let (middle, difference) = (0.5f32 * (xx + yy), 0.5f32 * (xx - yy));
        let spread = max(difference * difference + xy * xy, constant(MIN_EIGENVALUE_SPREAD));
        let radius = pixels(view.sigmas * (middle + spread.sqrt()).sqrt());
        (radius, radius)
    } else {
        (pixels(view.sigmas * xx.sqrt()), pixels(view.sigmas * yy.sqrt()))
    }
}

/// Rounds up to whole pixels. Larger values become [`MAX_RADIUS`], NaN becomes 0.
#[cube]
fn pixels(length: f32) -> i32 {
    let bound = comptime!(MAX_RADIUS as f32);
    let mut whole = 0;
    if length < bound {
        whole = i32::cast_from(length.ceil());
    } else if length >= bound {
        whole = comptime!(MAX_RADIUS);
    }
    whole
}
