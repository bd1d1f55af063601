//! Projection of Gaussians to ellipses on the image plane, one per lane (METHOD §8; EWA splatting).

#![allow(clippy::needless_range_loop, reason = "closures over vectors are compiled without the instruction set")]

use mvfusion_kernels::splat::{
    MIN_ALPHA, MIN_COMPENSATION, MIN_DETERMINANT, MIN_EIGENVALUE_SPREAD, MIN_QUATERNION_NORM, PROJECTED_LEN, Projected,
    REACH_SLACK,
};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::cloud::Cloud;
use super::lanes::Lane;
use super::sh::{self, MAX_COEFFICIENTS};
use super::tile_rectangle::TileRectangle;
use super::view::View;
use crate::Real;
use crate::simd::{Lanes, MAX_LANES, Mask, Number, Rows, Wide, cross, dot, to_rows};
use crate::splat::settings::{Antialias, Extent};

/// Gaussians per task.
pub(crate) const GAUSSIANS_PER_JOB: usize = 256;

/// Projected Gaussians: `records` is `[N, PROJECTED_LEN]`, `radii` is `[N, 2]` in pixels, 0 where culled.
pub(crate) struct Projections<T> {
    pub records: Vec<T>,
    pub radii: Vec<i32>,
}

/// Projects all Gaussians.
pub(crate) fn project<T: Lane>(cloud: &Cloud<T>, view: &View<T>) -> Projections<T> {
    let count = cloud.len();
    let mut records = vec![T::zero(); count * PROJECTED_LEN];
    let mut radii = vec![0i32; count * 2];
    let (record_rows, radius_rows) = (records.as_chunks_mut().0, radii.as_chunks_mut().0);
    let jobs = record_rows.par_chunks_mut(GAUSSIANS_PER_JOB).zip(radius_rows.par_chunks_mut(GAUSSIANS_PER_JOB));
    let arch = Arch::new();
    jobs.enumerate().for_each(|(job, (records, radii))| {
        arch.dispatch(ProjectionJob { cloud, view, first: job * GAUSSIANS_PER_JOB, records, radii });
    });
    Projections { records, radii }
}

/// The projections of consecutive Gaussians, which are zero before.
pub(super) struct ProjectionJob<'a, T> {
    pub cloud: &'a Cloud<'a, T>,
    pub view: &'a View<T>,
    /// Index of the first Gaussian.
    pub first: usize,
    pub records: &'a mut [[T; PROJECTED_LEN]],
    pub radii: &'a mut [[i32; 2]],
}

impl<T: Lane> WithSimd for ProjectionJob<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for rows in Rows::blocks(self.records.len(), Wide::<S, T>::LANES) {
            let own = rows.first..rows.first + rows.count;
            let (records, radii) = (&mut self.records[own.clone()], &mut self.radii[own]);
            project_rows(simd, self.cloud, self.view, rows.after(self.first), records.iter_mut().zip(radii));
        }
    }
}

/// Projects one Gaussian per lane, and writes the record and the radii of each that is not culled.
#[inline(always)]
fn project_rows<'a, S: Simd, T: Lane>(
    simd: S,
    cloud: &Cloud<T>,
    view: &View<T>,
    rows: Rows,
    outputs: impl Iterator<Item = (&'a mut [T; PROJECTED_LEN], &'a mut [i32; 2])>,
) {
    let geometry = Geometry::of(simd, cloud, view, rows);
    let (radii, centres, valid) = (geometry.radii(view), to_rows(geometry.centre), geometry.valid.to_lanes());
    let mut seen = [false; MAX_LANES];
    for lane in 0..rows.count {
        seen[lane] = valid[lane]
            && radii[lane][0] > 0
            && !TileRectangle::of(centres[lane], radii[lane], view).is_empty()
            && cloud.features_of(rows.first + lane).iter().all(|f| f.is_finite());
    }
    if !seen.contains(&true) {
        return;
    }
    let [logit] = rows.load(simd, cloud.values.opacity_logits, 1, 0);
    let opacity = sigmoid(logit) * geometry.compensation(view.antialias);
    let sh = load_coefficients(simd, cloud, view.sh_degree, rows);
    let direction = Direction::between(simd, cloud, view, rows).unit;
    let [red, green, blue] = sh::colour(view.sh_degree, direction, sh.as_flattened());
    let [xx, xy, yy] = geometry.covariance;
    let projected = Projected {
        centre: geometry.centre,
        curve_x: yy / geometry.determinant,
        slope: -xy / yy,
        curve_y: yy.value(1.0) / yy,
        opacity,
        reach: (opacity / T::of(MIN_ALPHA)).ln() + T::of(REACH_SLACK),
        depth: geometry.point[2],
        colour: [not_negative(red), not_negative(green), not_negative(blue)],
    };
    let finite = are_finite([logit, geometry.determinant, xx], &projected).to_lanes();
    let projected = to_rows(projected.to_row());
    for (lane, (record, radius)) in outputs.enumerate() {
        if seen[lane] && finite[lane] {
            (*record, *radius) = (projected[lane], radii[lane]);
        }
    }
}

/// Whether the projection is finite, and the numbers that it may hide: the logit, the determinant and the variance along
/// x. The reach is as finite as the opacity, or minus infinity if that has underflowed.
#[inline(always)]
fn are_finite<S: Simd, T: Lane>(numbers: [Wide<S, T>; 3], projected: &Projected<Wide<S, T>>) -> Mask<S, T> {
    // A number times zero is zero if it is finite, else NaN.
    let mut sum = projected.opacity.times(0.0);
    for x in numbers.into_iter().chain((Projected { reach: projected.opacity, ..*projected }).to_row()) {
        sum = sum + x.times(0.0);
    }
    sum.equal(sum.value(0.0))
}

/// Zero for negative numbers. `max` would turn NaN into zero.
#[inline(always)]
fn not_negative<S: Simd, T: Lanes>(x: Wide<S, T>) -> Wide<S, T> {
    let zero = x.value(0.0);
    x.less(zero).select(zero, x)
}

/// The logistic function.
#[inline(always)]
pub(crate) fn sigmoid<S: Simd, T: Lanes>(x: Wide<S, T>) -> Wide<S, T> {
    let one = x.value(1.0);
    one / (one + (-x).exp())
}

/// The coefficients of the colour up to a degree, then zeros.
#[inline(always)]
pub(crate) fn load_coefficients<S: Simd, T: Lane>(
    simd: S,
    cloud: &Cloud<T>,
    degree: usize,
    rows: Rows,
) -> [[Wide<S, T>; 3]; MAX_COEFFICIENTS] {
    let mut coefficients = [[Wide::splat(simd, T::zero()); 3]; MAX_COEFFICIENTS];
    let flat = coefficients.as_flattened_mut();
    let (sh, width) = (cloud.values.sh, 3 * cloud.sizes.coefficients);
    // Known lengths: the copies are unrolled, and each Gaussian's row is looked up once.
    match degree {
        0 => flat[..3].copy_from_slice(&rows.load::<_, _, 3>(simd, sh, width, 0)),
        1 => flat[..12].copy_from_slice(&rows.load::<_, _, 12>(simd, sh, width, 0)),
        2 => flat[..27].copy_from_slice(&rows.load::<_, _, 27>(simd, sh, width, 0)),
        _ => flat.copy_from_slice(&rows.load::<_, _, { 3 * MAX_COEFFICIENTS }>(simd, sh, width, 0)),
    }
    coefficients
}

/// A direction in world coordinates, and its norm before normalisation.
pub(crate) struct Direction<S: Simd, T: Lanes> {
    pub unit: [Wide<S, T>; 3],
    pub distance: Wide<S, T>,
}

impl<S: Simd, T: Lane> Direction<S, T> {
    /// Directions from the camera's centre to Gaussians.
    #[inline(always)]
    pub fn between(simd: S, cloud: &Cloud<T>, view: &View<T>, rows: Rows) -> Self {
        let [x, y, z] = rows.load(simd, cloud.values.means, 3, 0);
        let offset = [x - view.centre[0], y - view.centre[1], z - view.centre[2]];
        let distance = dot(offset, offset).sqrt();
        Self { unit: [offset[0] / distance, offset[1] / distance, offset[2] / distance], distance }
    }
}

/// Intermediate values of the projection of a Gaussian per lane, which the backward pass also uses.
pub(crate) struct Geometry<S: Simd, T: Lanes> {
    /// Between the near and the far plane, with a quaternion that can be normalised.
    pub valid: Mask<S, T>,
    /// Mean in camera coordinates.
    pub point: [Wide<S, T>; 3],
    /// Centre in pixels.
    pub centre: [Wide<S, T>; 2],
    /// `x / z` and `y / z`, clamped.
    pub tangents: [Wide<S, T>; 2],
    /// Whether the clamp left them unchanged.
    pub tangents_free: [Mask<S, T>; 2],
    /// Unit quaternion, w x y z, and its norm before normalisation.
    pub quaternion: [Wide<S, T>; 4],
    pub quaternion_norm: Wide<S, T>,
    pub scales: [Wide<S, T>; 3],
    /// Rotation matrix of the quaternion, in rows.
    pub rotation: [[Wide<S, T>; 3]; 3],
    /// Jacobian times the camera's rotation, 2 x 3.
    pub jacobian: [[Wide<S, T>; 3]; 2],
    /// `jacobian * rotation`, before the scales; the undilated covariance is `F Fᵀ` with `F = spread * diag(scales)`.
    pub spread: [[Wide<S, T>; 3]; 2],
    /// Covariance on the image plane with its dilation: xx, xy, yy.
    pub covariance: [Wide<S, T>; 3],
    /// Determinants of the covariance, with and without dilation.
    pub determinant: Wide<S, T>,
    pub sharp_determinant: Wide<S, T>,
}

impl<S: Simd, T: Lane> Geometry<S, T> {
    /// The geometry of Gaussians.
    #[inline(always)]
    pub fn of(simd: S, cloud: &Cloud<T>, view: &View<T>, rows: Rows) -> Self {
        let mean = rows.load(simd, cloud.values.means, 3, 0);
        let [right, down, forward] = view.rotation;
        let camera = [Wide::splat_each(simd, right), Wide::splat_each(simd, down), Wide::splat_each(simd, forward)];
        let [near, far, dilation, infinity] =
            Wide::splat_each(simd, [view.near, view.far, view.dilation, T::infinity()]);
        let focal = Wide::splat_each(simd, view.focal);
        let [lowest, highest] = [Wide::splat_each(simd, view.tangent_low), Wide::splat_each(simd, view.tangent_high)];
        let point = [
            dot(camera[0], mean) + view.translation[0],
            dot(camera[1], mean) + view.translation[1],
            dot(camera[2], mean) + view.translation[2],
        ];
        let depth = point[2];
        let [w, x, y, z] = rows.load(simd, cloud.values.quaternions, 4, 0);
        let quaternion_norm = (w * w + x * x + y * y + z * z).sqrt();
        let quaternion = [w / quaternion_norm, x / quaternion_norm, y / quaternion_norm, z / quaternion_norm];
        // Each test fails for NaN.
        let in_front = near.less(depth).and(depth.less(far));
        let long = depth.value(MIN_QUATERNION_NORM).less(quaternion_norm);
        let valid = in_front.and(long).and(quaternion_norm.less(infinity));

        let slopes = [point[0] / depth, point[1] / depth];
        let mut tangents = slopes;
        for axis in 0..2 {
            tangents[axis] = slopes[axis].at_least(lowest[axis]).at_most(highest[axis]);
        }
        let rotation = rotation_matrix(quaternion);
        let (mut jacobian, mut spread, mut centre) = ([[depth; 3]; 2], [[depth; 3]; 2], [depth; 2]);
        for axis in 0..2 {
            let zoom = focal[axis] / depth;
            for j in 0..3 {
                jacobian[axis][j] = zoom * (camera[axis][j] - tangents[axis] * camera[2][j]);
            }
            for j in 0..3 {
                spread[axis][j] = dot(jacobian[axis], [rotation[0][j], rotation[1][j], rotation[2][j]]);
            }
            centre[axis] = focal[axis] * point[axis] / (depth + view.depth_guard) + view.principal[axis];
        }
        let [x, y, z] = rows.load(simd, cloud.values.log_scales, 3, 0);
        let scales = [x.exp(), y.exp(), z.exp()];
        let (covariance, determinant, sharp_determinant) = covariance(spread, scales, dilation);
        Self {
            valid,
            point,
            centre,
            tangents,
            tangents_free: [tangents[0].equal(slopes[0]), tangents[1].equal(slopes[1])],
            quaternion,
            quaternion_norm,
            scales,
            rotation,
            jacobian,
            spread,
            covariance,
            determinant,
            sharp_determinant,
        }
    }

    /// Factor that compensates the opacity for the dilation.
    #[inline(always)]
    pub fn compensation(&self, antialias: Antialias) -> Wide<S, T> {
        match antialias {
            Antialias::Off => self.determinant.value(1.0),
            Antialias::Compensated => {
                let ratio = (self.sharp_determinant / self.determinant).sqrt();
                ratio.at_least(ratio.value(MIN_COMPENSATION))
            }
        }
    }

    /// Whether the compensation is at its lower bound, so that it has no gradient.
    #[inline(always)]
    pub fn compensation_is_bounded(&self) -> Mask<S, T> {
        let ratio = self.sharp_determinant / self.determinant;
        ratio.not_above(ratio.value(MIN_COMPENSATION * MIN_COMPENSATION))
    }

    /// Half sides of the rectangle that each Gaussian covers, in pixels, rounded up.
    #[inline(always)]
    fn radii(&self, view: &View<T>) -> [[i32; 2]; MAX_LANES] {
        let [xx, xy, yy] = self.covariance;
        let lengths = to_rows(match view.extent {
            Extent::Square { sigmas } => {
                let (middle, difference) = ((xx + yy).times(0.5), (xx - yy).times(0.5));
                let spread = difference * difference + xy * xy;
                let largest = middle + spread.at_least(xx.value(MIN_EIGENVALUE_SPREAD)).sqrt();
                [largest.sqrt().times(sigmas); 2]
            }
            Extent::PerAxis { sigmas } => [xx.sqrt().times(sigmas), yy.sqrt().times(sigmas)],
        });
        let mut radii = [[0; 2]; MAX_LANES];
        for lane in 0..Wide::<S, T>::LANES {
            radii[lane] = [pixels(lengths[lane][0]), pixels(lengths[lane][1])];
        }
        radii
    }
}

/// Rounds up to whole pixels. The result saturates; NaN becomes 0.
#[inline(always)]
fn pixels<T: Real>(length: T) -> i32 {
    length.ceil().wide() as i32
}

/// Covariance on the image plane with its dilation, its determinant, and the determinant without dilation.
///
/// The determinant of `F Fᵀ + e I` is `|f0 × f1|² + e (|f0|² + |f1|²) + e²` for the rows `f0`, `f1` of `F`: a sum of
/// positive terms, where `xx yy - xy²` would cancel for long, thin Gaussians in single precision.
#[inline(always)]
fn covariance<N: Number>(spread: [[N; 3]; 2], scales: [N; 3], dilation: N) -> ([N; 3], N, N) {
    let rows = [scaled(spread[0], scales), scaled(spread[1], scales)];
    let (xx, xy, yy) = (dot(rows[0], rows[0]), dot(rows[0], rows[1]), dot(rows[1], rows[1]));
    let normal = cross(rows[0], rows[1]);
    let sharp = dot(normal, normal);
    let determinant = sharp + dilation * (xx + yy) + dilation * dilation;
    ([xx + dilation, xy, yy + dilation], determinant.at_least(dilation.value(MIN_DETERMINANT)), sharp)
}

/// Rotation matrix of a unit quaternion, in rows.
#[inline(always)]
fn rotation_matrix<N: Number>([w, x, y, z]: [N; 4]) -> [[N; 3]; 3] {
    let (one, two) = (w.value(1.0), w.value(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

/// A row times a diagonal matrix.
#[inline(always)]
pub(crate) fn scaled<N: Number>(row: [N; 3], scales: [N; 3]) -> [N; 3] {
    [row[0] * scales[0], row[1] * scales[1], row[2] * scales[2]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rotation_of_a_quaternion_is_a_rotation() {
        let q = [0.5f64, -0.1, 0.7, 0.2];
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        let r = rotation_matrix(q.map(|x| x / norm));
        for i in 0..3 {
            for j in 0..3 {
                assert!((dot(r[i], r[j]) - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
        }
        assert!((dot(r[0], cross(r[1], r[2])) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_determinant_of_a_needle_does_not_cancel() {
        // In single precision, xx yy - xy² has no correct digits here.
        let spread = [[1e4f32, 1e-2, 0.0], [1e4, 0.0, 1e-2]];
        let (_, determinant, sharp) = covariance(spread, [1.0; 3], 0.3);
        let exact_sharp = 2e4 + 1e-8;
        assert!((f64::from(sharp) / exact_sharp - 1.0).abs() < 1e-5, "{sharp}");
        let exact = exact_sharp + 0.3 * (2e8 + 2e-4) + 0.09;
        assert!((f64::from(determinant) / exact - 1.0).abs() < 1e-5, "{determinant}");
    }

    #[test]
    fn lengths_that_no_pixel_count_holds_become_the_largest_or_none() {
        assert_eq!(pixels(2.1f32), 3);
        assert_eq!(pixels(f32::INFINITY), i32::MAX);
        assert_eq!(pixels(f32::NAN), 0);
    }
}
