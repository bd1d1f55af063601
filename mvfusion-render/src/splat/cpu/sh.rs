//! Colours from spherical harmonics, and their gradients.

use mvfusion_kernels::sh::{MAX_DEGREE, SH_C0, SH_C1, SH_C2, SH_C3, coefficient_count};

use crate::Real;

/// Coefficients of the highest degree.
pub(crate) const MAX_COEFFICIENTS: usize = coefficient_count(MAX_DEGREE);

/// The basis at a unit direction; entries beyond `degree` are zero.
pub(crate) fn basis<T: Real>(degree: usize, direction: [T; 3]) -> [T; MAX_COEFFICIENTS] {
    let [x, y, z] = direction;
    let mut basis = [T::zero(); MAX_COEFFICIENTS];
    basis[0] = T::of(SH_C0);
    if degree >= 1 {
        let c = T::of(SH_C1);
        basis[1..4].copy_from_slice(&[-c * y, c * z, -c * x]);
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (two, three, four) = (T::of(2.0), T::of(3.0), T::of(4.0));
    if degree >= 2 {
        let c = SH_C2.map(T::of);
        let values = [c[0] * x * y, c[1] * y * z, c[2] * (two * zz - xx - yy), c[3] * x * z, c[4] * (xx - yy)];
        basis[4..9].copy_from_slice(&values);
    }
    if degree >= 3 {
        let c = SH_C3.map(T::of);
        basis[9..16].copy_from_slice(&[
            c[0] * y * (three * xx - yy),
            c[1] * x * y * z,
            c[2] * y * (four * zz - xx - yy),
            c[3] * z * (two * zz - three * xx - three * yy),
            c[4] * x * (four * zz - xx - yy),
            c[5] * z * (xx - yy),
            c[6] * x * (xx - three * yy),
        ]);
    }
    basis
}

/// Colour of a Gaussian, `[3]`, before its clamp at zero: coefficients times basis, plus one half.
pub(crate) fn colour<T: Real>(degree: usize, direction: [T; 3], sh: &[T]) -> [T; 3] {
    let basis = basis(degree, direction);
    let mut colour = [T::of(0.5); 3];
    for (coefficient, value) in sh.as_chunks::<3>().0.iter().zip(basis).take(coefficient_count(degree)) {
        for (sum, &c) in colour.iter_mut().zip(coefficient) {
            *sum += value * c;
        }
    }
    colour
}

/// Gradient of `v_colour · colour` with respect to the direction, without the constraint of unit length.
pub(crate) fn direction_gradient<T: Real>(degree: usize, direction: [T; 3], sh: &[T], v_colour: [T; 3]) -> [T; 3] {
    let mut weights = [T::zero(); MAX_COEFFICIENTS];
    for (weight, row) in weights.iter_mut().zip(sh.as_chunks::<3>().0).take(coefficient_count(degree)) {
        *weight = row[0] * v_colour[0] + row[1] * v_colour[1] + row[2] * v_colour[2];
    }
    let mut gradient = [T::zero(); 3];
    for (weight, slope) in weights.iter().zip(basis_slopes(degree, direction)) {
        for (sum, s) in gradient.iter_mut().zip(slope) {
            *sum += *weight * s;
        }
    }
    gradient
}

/// Derivatives of each entry of the basis with respect to x, y, z.
fn basis_slopes<T: Real>(degree: usize, direction: [T; 3]) -> [[T; 3]; MAX_COEFFICIENTS] {
    let [x, y, z] = direction;
    let zero = T::zero();
    let mut slopes = [[zero; 3]; MAX_COEFFICIENTS];
    if degree >= 1 {
        let c = T::of(SH_C1);
        slopes[1..4].copy_from_slice(&[[zero, -c, zero], [zero, zero, c], [-c, zero, zero]]);
    }
    let (two, three, four, six, eight) = (T::of(2.0), T::of(3.0), T::of(4.0), T::of(6.0), T::of(8.0));
    if degree >= 2 {
        let c = SH_C2.map(T::of);
        slopes[4..9].copy_from_slice(&[
            [c[0] * y, c[0] * x, zero],
            [zero, c[1] * z, c[1] * y],
            [-two * c[2] * x, -two * c[2] * y, four * c[2] * z],
            [c[3] * z, zero, c[3] * x],
            [two * c[4] * x, -two * c[4] * y, zero],
        ]);
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    if degree >= 3 {
        let c = SH_C3.map(T::of);
        slopes[9..16].copy_from_slice(&[
            [c[0] * six * x * y, c[0] * three * (xx - yy), zero],
            [c[1] * y * z, c[1] * x * z, c[1] * x * y],
            [-two * c[2] * x * y, c[2] * (four * zz - xx - three * yy), c[2] * eight * y * z],
            [-six * c[3] * x * z, -six * c[3] * y * z, c[3] * (six * zz - three * xx - three * yy)],
            [c[4] * (four * zz - three * xx - yy), -two * c[4] * x * y, c[4] * eight * x * z],
            [two * c[5] * x * z, -two * c[5] * y * z, c[5] * (xx - yy)],
            [c[6] * three * (xx - yy), -six * c[6] * x * y, zero],
        ]);
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences of a cubic with step 1e-6 in double precision.
    const TOLERANCE: f64 = 1e-8;

    #[test]
    fn slopes_are_the_differences_of_the_basis() {
        let direction = [0.3, -0.7, 0.52];
        let slopes = basis_slopes(3, direction);
        for axis in 0..3 {
            let at = |step: f64| {
                let mut moved = direction;
                moved[axis] += step;
                basis(3, moved)
            };
            let (up, down) = (at(1e-6), at(-1e-6));
            for k in 0..MAX_COEFFICIENTS {
                assert!(((up[k] - down[k]) / 2e-6 - slopes[k][axis]).abs() < TOLERANCE, "entry {k}, axis {axis}");
            }
        }
    }

    #[test]
    fn degree_zero_is_the_same_from_everywhere() {
        let sh = [1.0, 2.0, -1.0];
        assert_eq!(colour(0, [0.0, 0.0, 1.0], &sh), colour(0, [1.0, 0.0, 0.0], &sh));
        assert!((colour(0, [0.0, 0.0, 1.0], &sh)[1] - (0.5 + 2.0 * SH_C0)).abs() < 1e-15);
    }

    #[test]
    fn coefficients_beyond_the_degree_are_not_read() {
        let mut sh = vec![0.1; 48];
        sh[12..].fill(f64::NAN);
        assert!(colour(1, [0.6, 0.0, 0.8], &sh).iter().all(|c| c.is_finite()));
        assert!(direction_gradient(1, [0.6, 0.0, 0.8], &sh, [1.0; 3]).iter().all(|c| c.is_finite()));
    }
}
