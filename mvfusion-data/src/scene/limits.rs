//! The numbers from files that training can compute with.
//!
//! Training computes in single precision, with squares of coordinates and sizes, and with products of these and focal
//! lengths. A number far below the largest float may therefore overflow.

use glam::Vec3;

/// Largest coordinate of a point, a Gaussian or a camera, in world units. Beyond it, neighbouring floats are more than
/// 64 units apart.
pub const LARGEST_COORDINATE: f64 = 1e9;

/// Largest coefficient of a colour, a logit or a quaternion. The structural loss multiplies four colours.
pub(crate) const LARGEST_COEFFICIENT: f64 = 1e6;

/// Smallest and largest logarithm of the size of a Gaussian: a float that is not denormal, and the largest coordinate.
pub(crate) const LOG_SIZES: [f32; 2] = [-87.0, 20.7];

/// Checks a position. The error is the problem.
pub(crate) fn check_place(place: Vec3) -> Result<(), String> {
    // Written so that NaN is no place.
    match place.to_array().iter().all(|value| f64::from(value.abs()) <= LARGEST_COORDINATE) {
        true => Ok(()),
        false => {
            Err(format!("is at {:?}; coordinates are numbers of at most {LARGEST_COORDINATE:e}", place.to_array()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_whose_squares_overflow_are_none() {
        for good in [0.0, -1e9, 1e9] {
            assert_eq!(check_place(Vec3::new(0.0, good, 1.0)), Ok(()));
        }
        for bad in [1.1e9, -1e38, f32::INFINITY, f32::NAN] {
            let said = check_place(Vec3::new(0.0, 1.0, bad)).expect_err("refused");
            assert!(said.contains("at most 1e9"), "{said}");
        }
    }

    #[test]
    fn squares_of_the_largest_numbers_are_floats() {
        let (largest, coefficient) = (LARGEST_COORDINATE as f32, LARGEST_COEFFICIENT as f32);
        assert!((largest * largest * 3.0).is_finite() && (2.0 * LOG_SIZES[1]).exp().is_finite());
        assert!((coefficient.powi(4) * 1e6).is_finite());
        assert!(LOG_SIZES[0].exp() >= f32::MIN_POSITIVE && f64::from(LOG_SIZES[1].exp()) <= LARGEST_COORDINATE);
    }
}
