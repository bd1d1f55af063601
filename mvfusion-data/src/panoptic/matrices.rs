//! Cameras as matrices.

use glam::{DMat3, DVec2, DVec3};

use crate::lens::{Bend, Lens};
use crate::rotation::rotation_of;

/// Rows of numbers, as many as the file has.
pub(super) type Matrix = Vec<Vec<f64>>;

/// How far what must be 0 or 1 may be from it, in pixels or in the scale of the last row.
const TOLERANCE: f64 = 1e-3;

/// The lens of a 3x3 matrix of intrinsics.
///
/// # Errors
/// If the matrix is none of a pinhole without skew.
pub(super) fn lens(k: &Matrix) -> Result<Lens, String> {
    let [[fx, skew, cx], [turned, fy, cy], last] = sized(k, "k")?;
    if ![skew, turned].iter().all(near(0.0)) || !is_last(&last) {
        return Err(format!("its k is {k:?}, and not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"));
    }
    if fx <= 0.0 || fy <= 0.0 {
        return Err(format!("its focal lengths in k are {fx} and {fy}; they must be above zero"));
    }
    Ok(Lens { focal: DVec2::new(fx, fy), principal: DVec2::new(cx, cy), bend: Bend::NONE })
}

/// The rotation and the translation of a 4x4 matrix.
///
/// # Errors
/// If the matrix is no rotation and shift.
pub(super) fn pose(matrix: &Matrix) -> Result<(DMat3, DVec3), String> {
    let [x, y, z, last]: [[f64; 4]; 4] = sized(matrix, "w2c")?;
    let axes = [x, y, z].map(|[a, b, c, _]| DVec3::new(a, b, c));
    let rotation = rotation_of(DMat3::from_cols(axes[0], axes[1], axes[2]).transpose());
    match rotation.filter(|_| is_last(&last)) {
        Some(rotation) => Ok((rotation, DVec3::new(x[3], y[3], z[3]))),
        None => Err(format!("its w2c is {matrix:?}, which is no rotation and shift")),
    }
}

/// A matrix of that size whose numbers are finite.
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

/// Whether a row is the last of a matrix that maps points: zeros and a one.
fn is_last(row: &[f64]) -> bool {
    row.split_last().is_some_and(|(one, zeros)| near(1.0)(one) && zeros.iter().all(near(0.0)))
}

fn near(wanted: f64) -> impl Fn(&f64) -> bool {
    move |value| (value - wanted).abs() <= TOLERANCE
}
