//! Gradients of the projection: from the records of the tiles to the raw parameters. CPU twin:
//! `splat/cpu/project_backward.rs`.

use cubecl::prelude::*;

use super::backward_kind::record_numbers;
use super::geometry::{Geometry, Matrix, Quaternion, compensation, geometry_of};
use super::maths::{Pair, Triple, constant, cross, dot, multiplied, scaled, sigmoid, sum};
use super::project::direction;
use super::records::sum_of_records;
use super::sh;
use super::stage::{FOUR, Four};
use super::view::{ProjectionKind, View};
use crate::sh::coefficient_count;
use crate::splat::{MIN_COMPENSATION, PROJECTED_LEN, feature_count, gradient_record, projected_row};

/// Sums the records of each Gaussian in the order of its tiles and backpropagates the sum through the projection.
///
/// `means` and `log_scales` are `[N, 3]`, `quaternions` `[N, 4]`, `opacity_logits` `[N]`, `coefficients`
/// `[N, stored, 3]`; `records` come from `project`. `slots` `[2 N + pairs]` begins with the start and the number of each
/// Gaussian's entries, and the entries follow. An entry is a row of `gradients`, of `record_vectors` vectors. Each
/// adjoint has the shape of its parameter; `v_features` is `[N, F]` and `statistic` `[N, 2]`.
#[cube(launch_unchecked)]
pub fn project_backward(
    means: &[f32],
    quaternions: &[f32],
    log_scales: &[f32],
    opacity_logits: &[f32],
    coefficients: &[f32],
    records: &[f32],
    slots: &[i32],
    gradients: &[Four],
    v_means: &mut [f32],
    v_quaternions: &mut [f32],
    v_log_scales: &mut [f32],
    v_opacity_logits: &mut [f32],
    v_coefficients: &mut [f32],
    v_features: &mut [f32],
    statistic: &mut [f32],
    view: View,
    count: u32,
    pairs: u32,
    stored: u32,
    #[comptime] pieced: bool,
    #[comptime] channels: usize,
    #[comptime] kind: ProjectionKind,
) {
    let index = ABSOLUTE_POS;
    if index < count as usize {
        let feature_count = comptime!(feature_count(channels));
        let (begin, own) = (slots[2 * index] as u32, slots[2 * index + 1] as u32);
        let sums = sum_of_records(slots, gradients, begin, begin + own, 2u32 * count, pairs, pieced, channels);
        let mut record = Array::<f32>::new(comptime!(record_numbers(channels)));
        #[unroll]
        for field in 0..comptime!(record_numbers(channels)) {
            record[field] = sums[comptime!(field / FOUR)].extract(comptime!(field % FOUR));
        }

        let first = index * stored as usize;
        if own > 0u32 {
            let geometry = geometry_of(means, quaternions, log_scales, index, &view);
            let logit = opacity_logits[index];
            let opacity = sigmoid(logit);
            let v_opacity = record[gradient_record::OPACITY];
            v_opacity_logits[index] = v_opacity * compensation(&geometry, kind.compensated) * opacity * sigmoid(-logit);
            let whitening = whitening_of(&geometry, view.dilation);
            let mut v_xx = record[gradient_record::WHITENED_XX];
            let mut v_xy = record[gradient_record::WHITENED_XY];
            let mut v_yy = record[gradient_record::WHITENED_YY];
            if comptime!(kind.compensated) {
                let more = compensation_gradient(&geometry, v_opacity * opacity, &whitening);
                v_xx += more.x;
                v_xy += more.y;
                v_yy += more.z;
            }
            let shape = shape_gradient(&geometry, &Triple { x: v_xx, y: v_xy, z: v_yy }, &whitening);
            v_quaternions[4 * index] = shape.quaternion.w;
            v_quaternions[4 * index + 1] = shape.quaternion.axis.x;
            v_quaternions[4 * index + 2] = shape.quaternion.axis.y;
            v_quaternions[4 * index + 3] = shape.quaternion.axis.z;
            write_triple(v_log_scales, index, &shape.log_scales);

            let v_centre = Pair { x: record[gradient_record::CENTRE_X], y: record[gradient_record::CENTRE_Y] };
            let v_depth = record[comptime!(gradient_record::depth(channels))];
            let v_point = point_gradient(&geometry, &view, &v_centre, v_depth, &shape);
            // A clamped colour has no gradient.
            let row = index * PROJECTED_LEN;
            let v_colour = Triple {
                x: select(records[row + projected_row::RED] > 0.0f32, record[gradient_record::RED], 0.0f32),
                y: select(records[row + projected_row::GREEN] > 0.0f32, record[gradient_record::GREEN], 0.0f32),
                z: select(records[row + projected_row::BLUE] > 0.0f32, record[gradient_record::BLUE], 0.0f32),
            };
            let (unit, distance) = direction(means, index, &view);
            let basis = sh::basis(&unit, kind.degree);
            #[unroll]
            for k in 0..comptime!(coefficient_count(kind.degree)) {
                write_triple(v_coefficients, first + k, &scaled(&v_colour, basis[k]));
            }
            let v_unit = sh::direction_gradient(&unit, coefficients, first, &v_colour, kind.degree);
            let across = sum(&v_unit, &scaled(&unit, -dot(&unit, &v_unit)));
            let through_point = sum(
                &sum(&scaled(&view.right, v_point.x), &scaled(&view.down, v_point.y)),
                &scaled(&view.forward, v_point.z),
            );
            write_triple(v_means, index, &sum(&through_point, &scaled(&across, 1.0f32 / distance)));
        } else {
            let zero = Triple { x: constant(0.0), y: constant(0.0), z: constant(0.0) };
            write_triple(v_means, index, &zero);
            write_triple(v_log_scales, index, &zero);
            #[unroll]
            for part in 0..4usize {
                v_quaternions[4 * index + part] = 0.0f32;
            }
            v_opacity_logits[index] = 0.0f32;
            #[unroll]
            for k in 0..comptime!(coefficient_count(kind.degree)) {
                write_triple(v_coefficients, first + k, &zero);
            }
        }
        // Coefficients above the rendered degree.
        for k in comptime!(coefficient_count(kind.degree))..stored as usize {
            write_triple(v_coefficients, first + k, &Triple { x: constant(0.0), y: constant(0.0), z: constant(0.0) });
        }
        #[unroll]
        for feature in 0..feature_count {
            v_features[index * feature_count + feature] = record[gradient_record::FEATURES + feature];
        }
        statistic[2 * index] = record[gradient_record::STATISTIC_X] * 0.5f32 * f32::cast_from(view.width);
        statistic[2 * index + 1] = record[gradient_record::STATISTIC_Y] * 0.5f32 * f32::cast_from(view.height);
    }
}

#[cube]
fn write_triple(numbers: &mut [f32], index: usize, triple: &Triple) {
    numbers[3 * index] = triple.x;
    numbers[3 * index + 1] = triple.y;
    numbers[3 * index + 2] = triple.z;
}

/// Gradients through the covariance.
#[derive(CubeType, Clone, Copy)]
struct ShapeGradient {
    quaternion: Quaternion,
    log_scales: Triple,
    /// With respect to the Jacobian times the camera's rotation, first row.
    jacobian_x: Triple,
    /// Second row.
    jacobian_y: Triple,
}

/// The whitening of the covariance, see the twin.
#[derive(CubeType, Clone, Copy)]
struct Whitening {
    along: f32,
    slope: f32,
    across: f32,
    /// The whitened rows, at most one in absolute value; the first.
    row_x: Triple,
    /// The second.
    row_y: Triple,
}

#[cube]
fn whitening_of(geometry: &Geometry, dilation: f32) -> Whitening {
    let (first, second) =
        (multiplied(&geometry.spread_x, &geometry.scales), multiplied(&geometry.spread_y, &geometry.scales));
    let yy = geometry.covariance.z;
    let inverse = 1.0f32 / yy;
    let (along, across) = ((yy / geometry.determinant).sqrt(), inverse.sqrt());
    // `first + slope second` would cancel for a long, thin Gaussian.
    let normal = cross(&first, &second);
    let sheared = sum(&cross(&second, &scaled(&normal, inverse)), &scaled(&first, inverse * dilation));
    Whitening {
        along,
        slope: -geometry.covariance.y * inverse,
        across,
        row_x: bounded(&scaled(&sheared, along)),
        row_y: bounded(&scaled(&second, across)),
    }
}

/// Cut to -1 and 1, which only rounding exceeds.
#[cube]
fn bounded(v: &Triple) -> Triple {
    Triple { x: clamp(v.x, -1.0f32, 1.0f32), y: clamp(v.y, -1.0f32, 1.0f32), z: clamp(v.z, -1.0f32, 1.0f32) }
}

/// Gradient of the whitened covariance through the compensation of the opacity; zero at the lower bound. See the twin.
#[cube]
fn compensation_gradient(geometry: &Geometry, v_compensation: f32, whitening: &Whitening) -> Triple {
    let ratio = geometry.sharp_determinant / geometry.determinant;
    let scale = 0.5f32 * v_compensation * ratio.sqrt();
    let sharp = scale / ratio;
    let (first, second) = (&whitening.row_x, &whitening.row_y);
    let free = ratio > constant(MIN_COMPENSATION * MIN_COMPENSATION);
    Triple {
        x: select(free, sharp * dot(second, second) - scale, 0.0f32),
        y: select(free, -2.0f32 * sharp * dot(first, second), 0.0f32),
        z: select(free, sharp * dot(first, first) - scale, 0.0f32),
    }
}

/// Gradient through `covariance = F Fᵀ + dilation`, `F = jacobian * rotation * diag(scales)`. `v` is the gradient with
/// respect to the whitened covariance.
#[cube]
fn shape_gradient(geometry: &Geometry, v: &Triple, whitening: &Whitening) -> ShapeGradient {
    let (first, second) = (&whitening.row_x, &whitening.row_y);
    let v_first = sum(&scaled(first, 2.0f32 * v.x), &scaled(second, v.y));
    let v_second = sum(&scaled(first, v.y), &scaled(second, 2.0f32 * v.z));
    let v_row_x = scaled(&v_first, whitening.along);
    let v_row_y = sum(&scaled(&v_first, whitening.along * whitening.slope), &scaled(&v_second, whitening.across));
    let (v_spread_x, v_spread_y) = (multiplied(&v_row_x, &geometry.scales), multiplied(&v_row_y, &geometry.scales));
    let (jacobian_x, jacobian_y) = (&geometry.jacobian_x, &geometry.jacobian_y);
    let v_rotation = Matrix {
        x: sum(&scaled(&v_spread_x, jacobian_x.x), &scaled(&v_spread_y, jacobian_y.x)),
        y: sum(&scaled(&v_spread_x, jacobian_x.y), &scaled(&v_spread_y, jacobian_y.y)),
        z: sum(&scaled(&v_spread_x, jacobian_x.z), &scaled(&v_spread_y, jacobian_y.z)),
    };
    ShapeGradient {
        quaternion: quaternion_gradient(geometry, &v_rotation),
        log_scales: sum(&multiplied(first, &v_first), &multiplied(second, &v_second)),
        jacobian_x: matrix_times(&geometry.rotation, &v_spread_x),
        jacobian_y: matrix_times(&geometry.rotation, &v_spread_y),
    }
}

/// A matrix times a column vector.
#[cube]
fn matrix_times(matrix: &Matrix, column: &Triple) -> Triple {
    Triple { x: dot(&matrix.x, column), y: dot(&matrix.y, column), z: dot(&matrix.z, column) }
}

/// Gradient through the rotation matrix and the normalisation of the quaternion, see the twin.
#[cube]
fn quaternion_gradient(geometry: &Geometry, v: &Matrix) -> Quaternion {
    let w = geometry.quaternion.w;
    let axis = &geometry.quaternion.axis;
    let twist = Triple { x: v.z.y - v.y.z, y: v.x.z - v.z.x, z: v.y.x - v.x.y };
    let trace = v.x.x + v.y.y + v.z.z;
    let symmetric = Triple {
        x: dot(&Triple { x: v.x.x + v.x.x, y: v.x.y + v.y.x, z: v.x.z + v.z.x }, axis),
        y: dot(&Triple { x: v.y.x + v.x.y, y: v.y.y + v.y.y, z: v.y.z + v.z.y }, axis),
        z: dot(&Triple { x: v.z.x + v.x.z, y: v.z.y + v.y.z, z: v.z.z + v.z.z }, axis),
    };
    let v_axis = scaled(&sum(&sum(&scaled(&twist, w), &symmetric), &scaled(axis, -2.0f32 * trace)), 2.0f32);
    let v_w = 2.0f32 * dot(axis, &twist);
    let along = v_w * w + dot(&v_axis, axis);
    let inverse = 1.0f32 / geometry.quaternion_norm;
    Quaternion { w: (v_w - w * along) * inverse, axis: scaled(&sum(&v_axis, &scaled(axis, -along)), inverse) }
}

/// Gradient of the mean in camera coordinates: through the centre, the depth and the Jacobian.
#[cube]
fn point_gradient(geometry: &Geometry, view: &View, v_centre: &Pair, v_depth: f32, shape: &ShapeGradient) -> Triple {
    let point = &geometry.point;
    let depth = point.z;
    let guarded = depth + view.depth_guard;
    let (zoom_x, zoom_y) = (view.focal.x / guarded, view.focal.y / guarded);
    let mut v_x = zoom_x * v_centre.x;
    let mut v_y = zoom_y * v_centre.y;
    let mut v_z = v_depth - zoom_x * point.x / guarded * v_centre.x - zoom_y * point.y / guarded * v_centre.y;
    v_z -= (dot(&shape.jacobian_x, &geometry.jacobian_x) + dot(&shape.jacobian_y, &geometry.jacobian_y)) / depth;
    let v_tangent_x = -view.focal.x / depth * dot(&shape.jacobian_x, &view.forward);
    let v_tangent_y = -view.focal.y / depth * dot(&shape.jacobian_y, &view.forward);
    if geometry.free_x {
        v_x += v_tangent_x / depth;
        v_z -= v_tangent_x * geometry.tangents.x / depth;
    }
    if geometry.free_y {
        v_y += v_tangent_y / depth;
        v_z -= v_tangent_y * geometry.tangents.y / depth;
    }
    Triple { x: v_x, y: v_y, z: v_z }
}
