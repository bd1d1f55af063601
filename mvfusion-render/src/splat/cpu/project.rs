//! Projection of a Gaussian to an ellipse on the image plane (METHOD §8; EWA splatting).

use mvfusion_kernels::splat::{
    MIN_ALPHA, MIN_COMPENSATION, MIN_DETERMINANT, MIN_EIGENVALUE_SPREAD, MIN_QUATERNION_NORM, PROJECTED_LEN, Projected,
    REACH_SLACK, projected_row,
};
use rayon::prelude::*;

use super::cloud::{Cloud, triple};
use super::lanes::Lane;
use super::sh;
use super::tile_rectangle::TileRectangle;
use super::view::View;
use crate::Real;
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
    let jobs =
        records.par_chunks_mut(GAUSSIANS_PER_JOB * PROJECTED_LEN).zip(radii.par_chunks_mut(GAUSSIANS_PER_JOB * 2));
    jobs.enumerate().for_each(|(job, (records, radii))| {
        let (records, radii) = (records.as_chunks_mut::<PROJECTED_LEN>().0, radii.as_chunks_mut::<2>().0);
        for (i, (record, radius)) in records.iter_mut().zip(radii).enumerate() {
            if let Some((projected, pixels)) = project_one(cloud, view, job * GAUSSIANS_PER_JOB + i) {
                (*record, *radius) = (projected.to_row(), pixels);
            }
        }
    });
    Projections { records, radii }
}

/// Projects one Gaussian; `None` if it is culled.
fn project_one<T: Lane>(cloud: &Cloud<T>, view: &View<T>, index: usize) -> Option<(Projected<T>, [i32; 2])> {
    let geometry = Geometry::of(cloud, view, index)?;
    let radii = geometry.radii(view);
    if radii[0] <= 0 || TileRectangle::of(geometry.centre, radii, view).is_empty() {
        return None;
    }
    let logit = cloud.values.opacity_logits[index];
    let opacity = sigmoid(logit) * geometry.compensation(view.antialias);
    let colour = sh::colour(view.sh_degree, Direction::between(cloud, view, index).unit, cloud.sh_of(index));
    let [_, xy, yy] = geometry.covariance;
    let projected = Projected {
        centre: geometry.centre,
        curve_x: yy / geometry.determinant,
        slope: -xy / yy,
        curve_y: T::one() / yy,
        opacity,
        reach: (opacity / T::of(MIN_ALPHA)).ln() + T::of(REACH_SLACK),
        depth: geometry.point[2],
        // `max` would turn NaN into zero.
        colour: colour.map(|c| if c < T::zero() { T::zero() } else { c }),
    };
    // The reach is minus infinity if the opacity has underflowed.
    let underflowed = |place: usize, x: T| place == projected_row::REACH && x < T::zero();
    let harmless = logit.is_finite()
        && cloud.features_of(index).iter().all(|f| f.is_finite())
        && projected.to_row().into_iter().enumerate().all(|(place, x)| x.is_finite() || underflowed(place, x));
    harmless.then_some((projected, radii))
}

/// The logistic function.
pub(crate) fn sigmoid<T: Real>(x: T) -> T {
    T::one() / (T::one() + (-x).exp())
}

/// A direction in world coordinates, and its norm before normalisation.
pub(crate) struct Direction<T> {
    pub unit: [T; 3],
    pub distance: T,
}

impl<T: Lane> Direction<T> {
    /// Direction from the camera's centre to a Gaussian.
    pub fn between(cloud: &Cloud<T>, view: &View<T>, index: usize) -> Self {
        let mean = triple(cloud.values.means, index);
        let offset: [T; 3] = std::array::from_fn(|i| mean[i] - view.centre[i]);
        let distance = dot(offset, offset).sqrt();
        Self { unit: offset.map(|x| x / distance), distance }
    }
}

/// Intermediate values of the projection of a Gaussian, which the backward pass also uses.
pub(crate) struct Geometry<T> {
    /// Mean in camera coordinates.
    pub point: [T; 3],
    /// Centre in pixels.
    pub centre: [T; 2],
    /// `x / z` and `y / z`, clamped.
    pub tangents: [T; 2],
    /// Whether the clamp left them unchanged.
    pub tangents_free: [bool; 2],
    /// Unit quaternion, w x y z, and its norm before normalisation.
    pub quaternion: [T; 4],
    pub quaternion_norm: T,
    /// Rotation matrix of the quaternion, in rows.
    pub rotation: [[T; 3]; 3],
    pub scales: [T; 3],
    /// Jacobian times the camera's rotation, 2 x 3.
    pub jacobian: [[T; 3]; 2],
    /// `jacobian * rotation`, before the scales; the undilated covariance is `F Fᵀ` with `F = spread * diag(scales)`.
    pub spread: [[T; 3]; 2],
    /// Covariance on the image plane with its dilation: xx, xy, yy.
    pub covariance: [T; 3],
    /// Determinants of the covariance, with and without dilation.
    pub determinant: T,
    pub sharp_determinant: T,
}

impl<T: Lane> Geometry<T> {
    /// The geometry of a Gaussian. `None` if it is in front of the near plane, beyond the far plane, or not finite.
    pub fn of(cloud: &Cloud<T>, view: &View<T>, index: usize) -> Option<Self> {
        let mean = triple(cloud.values.means, index);
        let point: [T; 3] = std::array::from_fn(|row| dot(view.rotation[row], mean) + view.translation[row]);
        let depth = point[2];
        // Written so that NaN fails.
        if !(depth > view.near && depth < view.far) {
            return None;
        }
        let raw: [T; 4] = std::array::from_fn(|i| cloud.values.quaternions[4 * index + i]);
        let quaternion_norm = raw.iter().map(|&q| q * q).sum::<T>().sqrt();
        if !(quaternion_norm > T::of(MIN_QUATERNION_NORM) && quaternion_norm.is_finite()) {
            return None;
        }
        let quaternion = raw.map(|q| q / quaternion_norm);
        let rotation = rotation_matrix(quaternion);
        let scales = triple(cloud.values.log_scales, index).map(|s| s.exp());

        let slopes = [point[0] / depth, point[1] / depth];
        let tangents: [T; 2] =
            std::array::from_fn(|axis| slopes[axis].max(view.tangent_low[axis]).min(view.tangent_high[axis]));
        let jacobian: [[T; 3]; 2] = std::array::from_fn(|axis| {
            let zoom = view.focal[axis] / depth;
            std::array::from_fn(|j| zoom * (view.rotation[axis][j] - tangents[axis] * view.rotation[2][j]))
        });
        let spread = jacobian.map(|row| {
            std::array::from_fn(|j| row[0] * rotation[0][j] + row[1] * rotation[1][j] + row[2] * rotation[2][j])
        });
        let (covariance, determinant, sharp_determinant) = covariance(spread, scales, view.dilation);
        Some(Self {
            point,
            centre: std::array::from_fn(|axis| {
                view.focal[axis] * point[axis] / (depth + view.depth_guard) + view.principal[axis]
            }),
            tangents,
            tangents_free: [tangents[0] == slopes[0], tangents[1] == slopes[1]],
            quaternion,
            quaternion_norm,
            rotation,
            scales,
            jacobian,
            spread,
            covariance,
            determinant,
            sharp_determinant,
        })
    }

    /// Factor that compensates the opacity for the dilation.
    pub fn compensation(&self, antialias: Antialias) -> T {
        match antialias {
            Antialias::Off => T::one(),
            Antialias::Compensated => (self.sharp_determinant / self.determinant).sqrt().max(T::of(MIN_COMPENSATION)),
        }
    }

    /// Whether the compensation is at its lower bound, so that it has no gradient.
    pub fn compensation_is_bounded(&self) -> bool {
        self.sharp_determinant / self.determinant <= T::of(MIN_COMPENSATION * MIN_COMPENSATION)
    }

    /// Half sides of the rectangle that the Gaussian covers, in pixels, rounded up.
    fn radii(&self, view: &View<T>) -> [i32; 2] {
        let [xx, xy, yy] = self.covariance;
        match view.extent {
            Extent::Square { sigmas } => {
                let half = T::of(0.5);
                let (middle, difference) = (half * (xx + yy), half * (xx - yy));
                let largest = middle + (difference * difference + xy * xy).max(T::of(MIN_EIGENVALUE_SPREAD)).sqrt();
                [pixels(T::of(sigmas) * largest.sqrt()); 2]
            }
            Extent::PerAxis { sigmas } => [pixels(T::of(sigmas) * xx.sqrt()), pixels(T::of(sigmas) * yy.sqrt())],
        }
    }
}

/// Rounds up to whole pixels. The result saturates; NaN becomes 0.
fn pixels<T: Real>(length: T) -> i32 {
    length.ceil().wide() as i32
}

/// Covariance on the image plane with its dilation, its determinant, and the determinant without dilation.
///
/// The determinant of `F Fᵀ + e I` is `|f0 × f1|² + e (|f0|² + |f1|²) + e²` for the rows `f0`, `f1` of `F`: a sum of
/// positive terms, where `xx yy - xy²` would cancel for long, thin Gaussians in single precision.
fn covariance<T: Real>(spread: [[T; 3]; 2], scales: [T; 3], dilation: T) -> ([T; 3], T, T) {
    let rows = spread.map(|row| [row[0] * scales[0], row[1] * scales[1], row[2] * scales[2]]);
    let (xx, xy, yy) = (dot(rows[0], rows[0]), dot(rows[0], rows[1]), dot(rows[1], rows[1]));
    let normal = cross(rows[0], rows[1]);
    let sharp = dot(normal, normal);
    let determinant = sharp + dilation * (xx + yy) + dilation * dilation;
    ([xx + dilation, xy, yy + dilation], determinant.max(T::of(MIN_DETERMINANT)), sharp)
}

/// Rotation matrix of a unit quaternion, in rows.
fn rotation_matrix<T: Real>([w, x, y, z]: [T; 4]) -> [[T; 3]; 3] {
    let (one, two) = (T::one(), T::of(2.0));
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

/// Scalar product.
#[inline(always)]
pub(crate) fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product.
#[inline(always)]
fn cross<T: Real>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
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
