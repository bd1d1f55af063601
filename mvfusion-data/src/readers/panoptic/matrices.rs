//! Cameras as matrices: intrinsics and poses.

use glam::{DMat3, DVec2, DVec3};

use crate::files::rotation_of;
use crate::scene::{Distortion, Lens};

/// Rows of numbers, of any length.
pub(super) type Matrix = Vec<Vec<f64>>;

/// Largest deviation from an exact 0 or 1, in pixels or in units of the last row.
const TOLERANCE: f64 = 1e-3;

/// The lens of a 3x3 intrinsics matrix.
///
/// # Errors
/// If the matrix does not belong to a pinhole camera without skew.
pub(super) fn lens(k: &Matrix) -> Result<Lens, String> {
    let [[fx, skew, cx], [turned, fy, cy], last] = sized(k, "k")?;
    if ![skew, turned].iter().all(near(0.0)) || !is_last(&last) {
        return Err(format!("its k is {k:?}, and not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"));
    }
    if fx <= 0.0 || fy <= 0.0 {
        return Err(format!("its focal lengths in k are {fx} and {fy}; they must be above zero"));
    }
    Ok(Lens { focal: DVec2::new(fx, fy), principal: DVec2::new(cx, cy), distortion: Distortion::NONE })
}

/// The rotation and translation of a 4x4 matrix.
///
/// # Errors
/// If the matrix is not a rigid transformation.
pub(super) fn pose(matrix: &Matrix) -> Result<(DMat3, DVec3), String> {
    let [x, y, z, last]: [[f64; 4]; 4] = sized(matrix, "w2c")?;
    let axes = [x, y, z].map(|[a, b, c, _]| DVec3::new(a, b, c));
    let rotation = rotation_of(DMat3::from_cols(axes[0], axes[1], axes[2]).transpose());
    match rotation.filter(|_| is_last(&last)) {
        Some(rotation) => Ok((rotation, DVec3::new(x[3], y[3], z[3]))),
        None => Err(format!("its w2c is {matrix:?}, which is no rotation and shift")),
    }
}

/// The numbers of a matrix of this size. All must be finite.
fn sized<const ROWS: usize, const COLUMNS: usize>(
    matrix: &Matrix,
    what: &str,
) -> Result<[[f64; COLUMNS]; ROWS], String> {
    if matrix.len() != ROWS || matrix.iter().any(|row| row.len() != COLUMNS) {
        return Err(format!("its {what} has not {ROWS} rows of {COLUMNS} numbers"));
    }
    if let Some(value) = matrix.iter().flatten().find(|value| !value.is_finite()) {
        return Err(format!("its {what} holds {value}"));
    }
    Ok(std::array::from_fn(|row| std::array::from_fn(|column| matrix[row][column])))
}

/// Whether a row is the last one of an affine matrix: zeros and a one.
fn is_last(row: &[f64]) -> bool {
    row.split_last().is_some_and(|(one, zeros)| near(1.0)(one) && zeros.iter().all(near(0.0)))
}

fn near(wanted: f64) -> impl Fn(&f64) -> bool {
    move |value| (value - wanted).abs() <= TOLERANCE
}
