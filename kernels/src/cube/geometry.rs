//! Intermediate values of the projection of a Gaussian. CPU twin: `Geometry` in `splat/cpu/project.rs`.

use cubecl::prelude::*;

use super::maths::{Pair, Triple, all_finite, constant, cross, dot, is_finite, multiplied, scaled, sum, triple_at};
use super::view::View;
use crate::splat::{MIN_COMPENSATION, MIN_DETERMINANT, MIN_QUATERNION_NORM};

/// A quaternion w, x, y, z.
#[derive(CubeType, Clone, Copy)]
pub struct Quaternion {
    /// The real part.
    pub w: f32,
    /// The imaginary parts.
    pub axis: Triple,
}

/// A 3 x 3 matrix in rows.
#[derive(CubeType, Clone, Copy)]
pub struct Matrix {
    /// First row.
    pub x: Triple,
    /// Second row.
    pub y: Triple,
    /// Third row.
    pub z: Triple,
}

/// All values between a Gaussian's raw parameters and its ellipse.
#[derive(CubeType, Clone, Copy)]
pub struct Geometry {
    /// Whether the Gaussian is between the near and the far plane and its parameters are finite.
    pub valid: bool,
    /// Mean in camera coordinates.
    pub point: Triple,
    /// Centre in pixels.
    pub centre: Pair,
    /// `x / z` and `y / z`, clamped.
    pub tangents: Pair,
    /// Whether the clamp left the first unchanged.
    pub free_x: bool,
    /// Whether the clamp left the second unchanged.
    pub free_y: bool,
    /// The normalised quaternion.
    pub quaternion: Quaternion,
    /// The norm of the raw quaternion.
    pub quaternion_norm: f32,
    /// Rotation matrix of the quaternion.
    pub rotation: Matrix,
    /// Standard deviations.
    pub scales: Triple,
    /// Jacobian times the camera's rotation, first row.
    pub jacobian_x: Triple,
    /// Second row.
    pub jacobian_y: Triple,
    /// Jacobian times both rotations, first row.
    pub spread_x: Triple,
    /// Second row.
    pub spread_y: Triple,
    /// Covariance on the image plane with its dilation: xx, xy, yy.
    pub covariance: Triple,
    /// Determinant of the covariance.
    pub determinant: f32,
    /// Determinant without dilation.
    pub sharp_determinant: f32,
}

/// The geometry of Gaussian `index`.
#[cube]
pub fn geometry_of(means: &[f32], quaternions: &[f32], log_scales: &[f32], index: usize, view: &View) -> Geometry {
    let mean = triple_at(means, index);
    let point = Triple {
        x: dot(&view.right, &mean) + view.translation.x,
        y: dot(&view.down, &mean) + view.translation.y,
        z: dot(&view.forward, &mean) + view.translation.z,
    };
    let depth = point.z;
    let raw = Quaternion {
        w: quaternions[4 * index],
        axis: Triple { x: quaternions[4 * index + 1], y: quaternions[4 * index + 2], z: quaternions[4 * index + 3] },
    };
    let norm = (raw.w * raw.w + dot(&raw.axis, &raw.axis)).sqrt();
    let log_scale = triple_at(log_scales, index);
    let scales = Triple { x: log_scale.x.exp(), y: log_scale.y.exp(), z: log_scale.z.exp() };
    let valid = all_finite(&point)
        && depth > view.near
        && depth < view.far
        && is_finite(norm)
        && norm > constant(MIN_QUATERNION_NORM)
        && all_finite(&scales);

    let inverse = 1.0f32 / norm;
    let quaternion = Quaternion { w: raw.w * inverse, axis: scaled(&raw.axis, inverse) };
    let rotation = rotation_matrix(&quaternion);
    let (slope_x, slope_y) = (point.x / depth, point.y / depth);
    let tangents = Pair {
        x: clamp(slope_x, view.tangent_low.x, view.tangent_high.x),
        y: clamp(slope_y, view.tangent_low.y, view.tangent_high.y),
    };
    let jacobian_x = jacobian_row(&view.right, &view.forward, tangents.x, view.focal.x / depth);
    let jacobian_y = jacobian_row(&view.down, &view.forward, tangents.y, view.focal.y / depth);
    let spread_x = row_times(&jacobian_x, &rotation);
    let spread_y = row_times(&jacobian_y, &rotation);

    // The determinant as a sum of positive terms, see the twin.
    let (row_x, row_y) = (multiplied(&spread_x, &scales), multiplied(&spread_y, &scales));
    let (xx, xy, yy) = (dot(&row_x, &row_x), dot(&row_x, &row_y), dot(&row_y, &row_y));
    let normal = cross(&row_x, &row_y);
    let sharp = dot(&normal, &normal);
    let full = sharp + view.dilation * (xx + yy) + view.dilation * view.dilation;
    let guarded = depth + view.depth_guard;
    let centre = Pair {
        x: view.focal.x * point.x / guarded + view.principal.x,
        y: view.focal.y * point.y / guarded + view.principal.y,
    };
    let free_x = tangents.x == slope_x;
    let free_y = tangents.y == slope_y;
    Geometry {
        valid,
        point,
        centre,
        tangents,
        free_x,
        free_y,
        quaternion,
        quaternion_norm: norm,
        rotation,
        scales,
        jacobian_x,
        jacobian_y,
        spread_x,
        spread_y,
        covariance: Triple { x: xx + view.dilation, y: xy, z: yy + view.dilation },
        determinant: max(full, constant(MIN_DETERMINANT)),
        sharp_determinant: sharp,
    }
}

/// Factor that compensates the opacity for the dilation.
#[cube]
pub fn compensation(geometry: &Geometry, #[comptime] compensated: bool) -> f32 {
    if comptime!(compensated) {
        max((geometry.sharp_determinant / geometry.determinant).sqrt(), constant(MIN_COMPENSATION))
    } else {
        constant(1.0)
    }
}

/// `zoom (rotation row - tangent * rotation's last row)`.
#[cube]
fn jacobian_row(row: &Triple, last: &Triple, tangent: f32, zoom: f32) -> Triple {
    scaled(&sum(row, &scaled(last, -tangent)), zoom)
}

/// A row vector times a matrix.
#[cube]
fn row_times(row: &Triple, matrix: &Matrix) -> Triple {
    sum(&sum(&scaled(&matrix.x, row.x), &scaled(&matrix.y, row.y)), &scaled(&matrix.z, row.z))
}

/// Rotation matrix of a unit quaternion.
#[cube]
fn rotation_matrix(q: &Quaternion) -> Matrix {
    let (w, x, y, z) = (q.w, q.axis.x, q.axis.y, q.axis.z);
    Matrix {
        x: Triple { x: 1.0f32 - 2.0f32 * (y * y + z * z), y: 2.0f32 * (x * y - w * z), z: 2.0f32 * (x * z + w * y) },
        y: Triple { x: 2.0f32 * (x * y + w * z), y: 1.0f32 - 2.0f32 * (x * x + z * z), z: 2.0f32 * (y * z - w * x) },
        z: Triple { x: 2.0f32 * (x * z - w * y), y: 2.0f32 * (y * z + w * x), z: 1.0f32 - 2.0f32 * (x * x + y * y) },
    }
}
