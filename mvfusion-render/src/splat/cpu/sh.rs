//! Colours from spherical harmonics, and their gradients, for one Gaussian or for a vector of them.

use mvfusion_kernels::sh::{MAX_DEGREE, SH_C0, SH_C1, SH_C2, SH_C3, coefficient_count};

use crate::simd::{Number, dot};

/// Coefficients of the highest degree.
pub(crate) const MAX_COEFFICIENTS: usize = coefficient_count(MAX_DEGREE);

/// The basis at a unit direction; entries beyond `degree` are zero.
#[inline(always)]
pub(crate) fn basis<N: Number>(degree: usize, direction: [N; 3]) -> [N; MAX_COEFFICIENTS] {
    let [x, y, z] = direction;
    let mut basis = [x.value(0.0); MAX_COEFFICIENTS];
    basis[0] = x.value(SH_C0);
    if degree >= 1 {
        basis[1] = -y.times(SH_C1);
        basis[2] = z.times(SH_C1);
        basis[3] = -x.times(SH_C1);
    }
    let (xx, yy, zz) = (x * x, y * y, z * z);
    if degree >= 2 {
        basis[4] = x.times(SH_C2[0]) * y;
        basis[5] = y.times(SH_C2[1]) * z;
        basis[6] = (zz.times(2.0) - xx - yy).times(SH_C2[2]);
        basis[7] = x.times(SH_C2[3]) * z;
        basis[8] = (xx - yy).times(SH_C2[4]);
    }
    if degree >= 3 {
        basis[9] = y.times(SH_C3[0]) * (xx.times(3.0) - yy);
        basis[10] = x.times(SH_C3[1]) * y * z;
        basis[11] = y.times(SH_C3[2]) * (zz.times(4.0) - xx - yy);
        basis[12] = z.times(SH_C3[3]) * (zz.times(2.0) - xx.times(3.0) - yy.times(3.0));
        basis[13] = x.times(SH_C3[4]) * (zz.times(4.0) - xx - yy);
        basis[14] = z.times(SH_C3[5]) * (xx - yy);
        basis[15] = x.times(SH_C3[6]) * (xx - yy.times(3.0));
    }
    basis
}

/// Colour of a Gaussian, `[3]`, before its clamp at zero: coefficients times basis, plus one half.
#[inline(always)]
pub(crate) fn colour<N: Number>(degree: usize, direction: [N; 3], sh: &[N]) -> [N; 3] {
    let basis = basis(degree, direction);
    let mut colour = [direction[0].value(0.5); 3];
    for (coefficient, value) in sh.as_chunks::<3>().0.iter().zip(basis).take(coefficient_count(degree)) {
        for (sum, &c) in colour.iter_mut().zip(coefficient) {
            *sum = *sum + value * c;
        }
    }
    colour
}

/// Gradient of `v_colour · colour` with respect to the direction, without the constraint of unit length.
#[inline(always)]
pub(crate) fn direction_gradient<N: Number>(degree: usize, direction: [N; 3], sh: &[N], v_colour: [N; 3]) -> [N; 3] {
    let mut gradient = [direction[0].value(0.0); 3];
    let slopes = basis_slopes(degree, direction);
    for (row, slope) in sh.as_chunks::<3>().0.iter().zip(slopes).take(coefficient_count(degree)) {
        let weight = dot(*row, v_colour);
        for (sum, s) in gradient.iter_mut().zip(slope) {
            *sum = *sum + weight * s;
        }
    }
    gradient
}

/// Derivatives of each entry of the basis with respect to x, y, z.
#[inline(always)]
fn basis_slopes<N: Number>(degree: usize, direction: [N; 3]) -> [[N; 3]; MAX_COEFFICIENTS] {
    let [x, y, z] = direction;
    let zero = x.value(0.0);
    let mut slopes = [[zero; 3]; MAX_COEFFICIENTS];
    if degree >= 1 {
        let c = x.value(SH_C1);
        slopes[1] = [zero, -c, zero];
        slopes[2] = [zero, zero, c];
        slopes[3] = [-c, zero, zero];
    }
    if degree >= 2 {
        let c = SH_C2;
        slopes[4] = [y.times(c[0]), x.times(c[0]), zero];
        slopes[5] = [zero, z.times(c[1]), y.times(c[1])];
        slopes[6] = [x.times(-2.0 * c[2]), y.times(-2.0 * c[2]), z.times(4.0 * c[2])];
        slopes[7] = [z.times(c[3]), zero, x.times(c[3])];
        slopes[8] = [x.times(2.0 * c[4]), y.times(-2.0 * c[4]), zero];
    }
    if degree >= 3 {
        let c = SH_C3;
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let (xy, xz, yz) = (x * y, x * z, y * z);
        slopes[9] = [xy.times(6.0 * c[0]), (xx - yy).times(3.0 * c[0]), zero];
        slopes[10] = [yz.times(c[1]), xz.times(c[1]), xy.times(c[1])];
        slopes[11] = [xy.times(-2.0 * c[2]), (zz.times(4.0) - xx - yy.times(3.0)).times(c[2]), yz.times(8.0 * c[2])];
        slopes[12] =
            [xz.times(-6.0 * c[3]), yz.times(-6.0 * c[3]), (zz.times(6.0) - xx.times(3.0) - yy.times(3.0)).times(c[3])];
        slopes[13] = [(zz.times(4.0) - xx.times(3.0) - yy).times(c[4]), xy.times(-2.0 * c[4]), xz.times(8.0 * c[4])];
        slopes[14] = [xz.times(2.0 * c[5]), yz.times(-2.0 * c[5]), (xx - yy).times(c[5])];
        slopes[15] = [(xx - yy).times(3.0 * c[6]), xy.times(-6.0 * c[6]), zero];
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
