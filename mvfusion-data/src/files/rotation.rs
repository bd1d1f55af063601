//! Rotations from files with few digits.

use glam::{DMat3, DQuat};

/// Largest deviation of a pose's axes from orthonormality. Files with few digits err by 1e-4.
const TOLERANCE: f64 = 1e-2;

/// The rotation closest to a matrix of rounded numbers; `None` if the matrix is not a rotation.
pub(crate) fn rotation_of(axes: DMat3) -> Option<DMat3> {
    let off = axes * axes.transpose() - DMat3::IDENTITY;
    // Written so that NaN is rejected.
    let orthonormal = off.to_cols_array().iter().all(|v| v.abs() <= TOLERANCE);
    (orthonormal && axes.determinant() > 0.0).then(|| DMat3::from_quat(DQuat::from_mat3(&axes).normalize()))
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn rounded_rotations_are_made_exact_and_others_are_none() {
        let turn = DMat3::from_axis_angle(DVec3::new(0.2, 0.9, -0.1).normalize(), 0.7);
        let rounded = DMat3::from_cols_array(&turn.to_cols_array().map(|v| (v * 1e4).round() * 1e-4));
        let exact = rotation_of(rounded).expect("a rotation");
        assert!((exact * exact.transpose() - DMat3::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 1e-14));
        assert!((exact - turn).to_cols_array().iter().all(|v| v.abs() < 1e-4));
        for other in [DMat3::ZERO, -turn, turn * 1.1, DMat3::from_cols_array(&[f64::NAN; 9])] {
            assert_eq!(rotation_of(other), None, "{other}");
        }
    }
}
