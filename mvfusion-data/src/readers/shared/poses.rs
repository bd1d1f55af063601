//! `poses_bounds.npy`: the cameras of LLFF and Neu3D scenes, one per row.

use std::path::Path;

use glam::{DMat3, DVec3};

use crate::error::DataError;
use crate::files::read_npy;
use crate::scene::{Camera, LARGEST_COORDINATE};

/// Numbers in a row: a 3x5 matrix row by row, then the near and far bounds.
pub const ROW: usize = 17;

/// Largest deviation of a pose's columns from orthonormality. Single-precision files err by 1e-6.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// The camera of a row of `poses_bounds.npy`, for images of `width` by `height` pixels (METHOD §5.1).
///
/// A row is a 3x5 matrix, row by row, followed by the near and far depth bounds. The first three columns of the matrix
/// are the camera's down, right and backward axes in the world, the fourth is its centre. The last column is (height,
/// width, focal length in pixels of that width). The focal length is scaled to `width`, pixels are square, and the
/// principal point is centred.
///
/// Departure: the original gives all cameras the focal length of the first; here each row has its own.
pub fn camera_from_row(row: &[f64; ROW], width: usize, height: usize) -> Camera {
    let column = |c: usize| DVec3::new(row[c], row[5 + c], row[10 + c]);
    let (down, right, backward, centre) = (column(0), column(1), column(2), column(3));
    let focal = row[14] * width as f64 / row[9];
    Camera::centred(width, height, focal, DMat3::from_cols(right, down, -backward), centre)
}

/// The near bound of a row, in world units; `None` if it is not positive.
pub(crate) fn near_bound(row: &[f64; ROW]) -> Option<f64> {
    Some(row[15]).filter(|&near| near > 0.0)
}

/// Reads `poses_bounds.npy`: `[cameras, 17]`, double or single precision.
///
/// # Errors
/// [`DataError::Content`] if it is not such an array, or a row is not a camera.
pub(crate) fn read_rows(path: &Path) -> Result<Vec<[f64; ROW]>, DataError> {
    let fail = |reason: String| DataError::Content {
        path: path.to_owned(),
        reason,
        advice: "It must hold one row of 17 floating-point numbers a camera, as LLFF's imgs2poses.py writes them",
    };
    let rows = read_array(path).map_err(fail)?;
    for (index, row) in rows.iter().enumerate() {
        check_row(row).map_err(|reason| fail(format!("row {index} {reason}")))?;
    }
    Ok(rows)
}

fn read_array(path: &Path) -> Result<Vec<[f64; ROW]>, String> {
    let table = read_npy(path, ROW..=ROW)?;
    let rows: Vec<_> = table.rows().map(|row| std::array::from_fn(|column| row[column])).collect();
    if rows.is_empty() { Err("it has no rows".into()) } else { Ok(rows) }
}

/// Checks a row. The error is the problem.
fn check_row(row: &[f64; ROW]) -> Result<(), String> {
    if let Some(at) = row.iter().position(|v| !v.is_finite()) {
        return Err(format!("holds {} at column {at}, which is not a finite number", row[at]));
    }
    if let Some(at) = row.iter().position(|v| v.abs() > LARGEST_COORDINATE) {
        return Err(format!("holds {:e} at column {at}, and the largest number is {LARGEST_COORDINATE:e}", row[at]));
    }
    let (height, width, focal) = (row[4], row[9], row[14]);
    if height <= 0.0 || width <= 0.0 || focal <= 0.0 {
        return Err(format!("has height {height}, width {width}, focal length {focal}; all must be above zero"));
    }
    let axes = camera_from_row(row, 2, 2).rotation;
    let error =
        (axes * axes.transpose() - DMat3::IDENTITY).to_cols_array().iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    if error > ROTATION_TOLERANCE || axes.determinant() < 0.0 {
        return Err("has axes that are not a rotation".into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding tolerance for a few products of numbers near one.
    const ROUNDING: f64 = 1e-12;

    /// A camera at (1, 2, 3) that looks along the world's -z with x right, y up: right = x, down = -y, backward = z.
    const ROW_ALONG_MINUS_Z: [f64; ROW] = [0., 1., 0., 1., 400., -1., 0., 0., 2., 600., 0., 0., 1., 3., 300., 0.1, 9.];

    #[test]
    fn a_row_gives_the_camera_of_its_axes_and_centre() {
        let camera = camera_from_row(&ROW_ALONG_MINUS_Z, 300, 200);
        assert!((camera.centre() - DVec3::new(1.0, 2.0, 3.0)).length() < ROUNDING);
        assert!((camera.forward() - DVec3::NEG_Z).length() < ROUNDING);
        assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (150.0, 150.0, 150.0, 100.0));
        let right_and_up = camera.project(DVec3::new(2.0, 3.0, 1.0)).expect("in front");
        assert!((right_and_up - glam::DVec2::new(225.0, 25.0)).length() < ROUNDING, "{right_and_up}");
    }

    #[test]
    fn rows_that_are_no_camera_are_refused() {
        assert!(check_row(&ROW_ALONG_MINUS_Z).is_ok());
        for (column, value, part) in [
            (3, f64::NAN, "not a finite"),
            (3, 1e38, "1e38 at column 3"),
            (14, 0.0, "focal"),
            (1, -1.0, "rotation"),
            (6, 0.4, "rotation"),
        ] {
            let mut row = ROW_ALONG_MINUS_Z;
            row[column] = value;
            assert!(check_row(&row).expect_err("refused").contains(part));
        }
    }
}
