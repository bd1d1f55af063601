//! Coefficients of the real spherical-harmonic basis, with the signs that 3DGS uses (METHOD §1.1).

/// Highest degree that is evaluated.
pub const MAX_DEGREE: usize = 3;
/// Degree 0: the constant term; `colour = SH_C0 * coefficient + 0.5`.
pub const SH_C0: f64 = 0.282_094_791_773_878_14;
/// Degree 1, in the order -y, z, -x.
pub const SH_C1: f64 = 0.488_602_511_902_919_9;
/// Degree 2: xy, yz, 2zz - xx - yy, xz, xx - yy.
pub const SH_C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
/// Degree 3: y(3xx - yy), xyz, y(4zz - xx - yy), z(2zz - 3xx - 3yy), x(4zz - xx - yy), z(xx - yy), x(xx - 3yy).
pub const SH_C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];

/// Number of coefficients of all degrees up to `degree`.
pub const fn coefficient_count(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}
