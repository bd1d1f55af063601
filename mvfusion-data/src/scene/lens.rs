//! Lenses: the mapping between directions and pixels, with distortion.
//!
//! A direction is given by its intersection with the plane at distance one in front of the camera. The lens distorts
//! that point, then focal lengths and principal point turn it into pixels. The models are those of COLMAP, which
//! include OpenCV's. `colmap/doc/cameras.rst` and OpenCV's `calib3d` document the formulas.

use glam::{DMat2, DVec2};

/// Maximum number of steps of Newton's method. An invertible lens needs about six.
const STEPS: usize = 32;

/// Largest error of an inversion, on the plane at distance one. It is far below a pixel.
const EXACT: f64 = 1e-10;

/// Step of the finite differences for the Jacobian. It only steers Newton's method and need not be exact.
const DIFFERENCE: f64 = 1e-6;

/// A lens: intrinsics and distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal lengths along x and y, in pixels.
    pub focal: DVec2,
    /// Principal point, in pixels. The centre of the first pixel is at 0.5.
    pub principal: DVec2,
    /// Distortion.
    pub distortion: Distortion,
}

/// Distortion of points on the plane at distance one. If all coefficients are zero, it is a pinhole.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// `x (1 + n1 r² + n2 r⁴ + n3 r⁶ + n4 r⁸) / (1 + d1 r² + d2 r⁴ + d3 r⁶)` plus the tangential shift. With n4 = 0, this
    /// is OpenCV's model, whose first coefficients alone are COLMAP's SIMPLE_RADIAL, RADIAL and OPENCV. With n4 and no
    /// denominator, it is that of Metashape and nerfstudio.
    Perspective {
        /// n1 … n4.
        numerator: [f64; 4],
        /// d1 … d3.
        denominator: [f64; 3],
        /// p1, p2. The shift is `(2 p1 x y + p2 (r² + 2 x²), p1 (r² + 2 y²) + 2 p2 x y)`.
        tangential: [f64; 2],
    },
    /// A point at the angle θ from the axis moves to the distance θ, then to `θ (1 + k1 θ² + … + k6 θ¹²)`, and is
    /// shifted.
    Fisheye {
        /// k1 … k6.
        radial: [f64; 6],
        /// As in [`Distortion::Perspective`].
        tangential: [f64; 2],
        /// Thin prism: x moves by `s1 r² + s2 r⁴`, y by `s3 r² + s4 r⁴`.
        prism: [f64; 4],
        /// Whether the shifts use the point after its radial distortion (Aria's order) or before it (COLMAP's thin
        /// prism).
        shifted_last: bool,
    },
    /// The distance r becomes `atan(2 r tan(ω/2)) / ω`.
    Angular {
        /// ω, the field of view in radians.
        omega: f64,
    },
    /// Fitzgibbon's division model. Its formula is the inverse: a point at the distance r comes from `r / (1 + k r²)`.
    Division {
        /// k.
        k: f64,
    },
    /// The enhanced unified model: a point is divided by `α √(β r² + 1) + 1 - α`.
    Unified {
        /// α, from 0 to 1.
        alpha: f64,
        /// β, above 0.
        beta: f64,
    },
}

impl Distortion {
    /// A pinhole.
    pub const NONE: Self = Self::opencv([0.0; 6], [0.0; 2]);

    /// OpenCV's model with the coefficients k1 … k6, of which k4 … k6 are those of the denominator, and p1, p2.
    pub const fn opencv([k1, k2, k3, k4, k5, k6]: [f64; 6], tangential: [f64; 2]) -> Self {
        Self::Perspective { numerator: [k1, k2, k3, 0.0], denominator: [k4, k5, k6], tangential }
    }

    /// The distorted point.
    fn distorted(&self, point: DVec2) -> DVec2 {
        match *self {
            Self::Perspective { numerator: [n1, n2, n3, n4], denominator: [d1, d2, d3], tangential } => {
                let r2 = point.length_squared();
                let above = 1.0 + r2 * (n1 + r2 * (n2 + r2 * (n3 + r2 * n4)));
                let below = 1.0 + r2 * (d1 + r2 * (d2 + r2 * d3));
                point * (above / below) + shift(point, tangential)
            }
            Self::Fisheye { .. } => self.distorted_on_sphere(to_angle(point)),
            Self::Angular { omega } => {
                let r = point.length();
                // Both are the limits for a vanishing angle.
                let slope = if omega.abs() < 1e-9 { 1.0 } else { 2.0 * (0.5 * omega).tan() / omega };
                if r * omega.abs() < 1e-9 { point * slope } else { point * (r * omega * slope).atan() / (r * omega) }
            }
            // Points outside the lens's field of view are mapped to its edge.
            Self::Division { k } => point * 2.0 / (1.0 + (1.0 - 4.0 * k * point.length_squared()).max(0.0).sqrt()),
            Self::Unified { alpha, beta } => {
                point / (alpha * (beta * point.length_squared() + 1.0).sqrt() + 1.0 - alpha)
            }
        }
    }

    /// The fisheye distortion of a point whose distance from the axis is its angle.
    fn distorted_on_sphere(&self, point: DVec2) -> DVec2 {
        let Self::Fisheye { radial, tangential, prism: [s1, s2, s3, s4], shifted_last } = *self else { return point };
        let r2 = point.length_squared();
        let stretched = point * (1.0 + radial.iter().rev().fold(0.0, |sum, k| (sum + k) * r2));
        let base = if shifted_last { stretched } else { point };
        let b2 = base.length_squared();
        stretched + shift(base, tangential) + DVec2::new(s1 * b2 + s2 * b2 * b2, s3 * b2 + s4 * b2 * b2)
    }

    /// Whether there is no distortion.
    pub fn is_none(&self) -> bool {
        matches!(self, Self::Perspective { numerator, denominator, tangential }
            if numerator.iter().chain(denominator).chain(tangential).all(|k| *k == 0.0))
    }

    /// The point whose distortion is `seen`; `None` if there is none in front of the camera.
    fn undistorted(&self, seen: DVec2) -> Option<DVec2> {
        match *self {
            Self::Perspective { .. } if self.is_none() => Some(seen),
            Self::Perspective { .. } => solve(|point| self.distorted(point), seen),
            Self::Fisheye { .. } => {
                let on_sphere = solve(|point| self.distorted_on_sphere(point), seen)?;
                let angle = on_sphere.length();
                (angle < std::f64::consts::FRAC_PI_2).then(|| on_sphere * ratio(angle.tan(), angle))
            }
            Self::Angular { omega } => {
                let (r, half) = (seen.length(), (0.5 * omega).tan());
                let angle = r * omega;
                if omega.abs() < 1e-9 {
                    return Some(seen);
                }
                (angle.abs() < std::f64::consts::FRAC_PI_2).then(|| {
                    if r < 1e-12 { seen * omega / (2.0 * half) } else { seen * angle.tan() / (2.0 * half * r) }
                })
            }
            Self::Division { k } => {
                // From 1 on, the image folds back; below -1, it shows points behind the camera.
                let change = k * seen.length_squared();
                (change.abs() < 1.0).then(|| seen / (1.0 + change))
            }
            Self::Unified { alpha, beta } => {
                let (r2, rest) = (seen.length_squared(), 1.0 - alpha);
                let root = (1.0 - (alpha - rest) * beta * r2).sqrt();
                let depth = (1.0 - alpha * alpha * beta * r2) / (alpha * root + rest);
                (depth > 0.0).then(|| seen / depth)
            }
        }
    }
}

impl Lens {
    /// The pixel position of a direction, given by its point at distance one.
    pub fn pixel_of(&self, point: DVec2) -> DVec2 {
        self.focal * self.distortion.distorted(point) + self.principal
    }

    /// The direction of a pixel position, as its point at distance one. `None` if the lens sees nothing in front of the
    /// camera there.
    pub fn direction_of(&self, pixel: DVec2) -> Option<DVec2> {
        self.distortion.undistorted((pixel - self.principal) / self.focal)
    }

    /// The same lens for an image scaled by `factor` along x and y.
    pub fn scaled(&self, factor: DVec2) -> Self {
        Self { focal: self.focal * factor, principal: self.principal * factor, ..*self }
    }
}

/// OpenCV's tangential shift.
fn shift(point: DVec2, [p1, p2]: [f64; 2]) -> DVec2 {
    let (xy, r2) = (2.0 * point.x * point.y, point.length_squared());
    DVec2::new(p1 * xy + p2 * (r2 + 2.0 * point.x * point.x), p1 * (r2 + 2.0 * point.y * point.y) + p2 * xy)
}

/// The point in the same direction from the axis whose distance is the angle of `point`.
fn to_angle(point: DVec2) -> DVec2 {
    let r = point.length();
    point * ratio(r.atan(), r)
}

/// `a / b`, and its limit 1 where both vanish alike.
fn ratio(a: f64, b: f64) -> f64 {
    if b < 1e-12 { 1.0 } else { a / b }
}

/// The point that `map` takes to `target`, by Newton's method. A step that increases the error is halved.
fn solve(map: impl Fn(DVec2) -> DVec2, target: DVec2) -> Option<DVec2> {
    let mut point = target;
    let mut rest = map(point) - target;
    for _ in 0..STEPS {
        if rest.length() < EXACT {
            return Some(point);
        }
        let slope = |step: DVec2| (map(point + step) - map(point - step)) / (2.0 * DIFFERENCE);
        let jacobian = DMat2::from_cols(slope(DVec2::new(DIFFERENCE, 0.0)), slope(DVec2::new(0.0, DIFFERENCE)));
        // Beyond its fold, a lens shows everything twice.
        if jacobian.determinant() <= 0.0 || !jacobian.determinant().is_finite() {
            return None;
        }
        let step = jacobian.inverse() * rest;
        let next = (0..8).map(|half| point - step * 0.5f64.powi(half)).find(|&p| {
            let distance = (map(p) - target).length();
            distance.is_finite() && distance < rest.length()
        })?;
        (point, rest) = (next, map(next) - target);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lenses() -> Vec<(&'static str, Distortion)> {
        let perspective = Distortion::opencv;
        let fisheye =
            |radial, tangential, prism, shifted_last| Distortion::Fisheye { radial, tangential, prism, shifted_last };
        vec![
            ("pinhole", Distortion::NONE),
            ("radial", perspective([-0.12, 0.03, 0.0, 0.0, 0.0, 0.0], [0.0; 2])),
            ("opencv", perspective([-0.1, 0.02, 0.0, 0.0, 0.0, 0.0], [1e-3, -2e-3])),
            (
                "metashape",
                Distortion::Perspective {
                    numerator: [-0.1, 0.02, -0.01, 0.05],
                    denominator: [0.0; 3],
                    tangential: [1e-3; 2],
                },
            ),
            ("rational", perspective([0.3, 0.05, 0.01, 0.35, 0.06, 0.01], [5e-4, 3e-4])),
            ("equidistant", fisheye([0.0; 6], [0.0; 2], [0.0; 4], false)),
            ("opencv fisheye", fisheye([0.02, -0.01, 0.003, -5e-4, 0.0, 0.0], [0.0; 2], [0.0; 4], false)),
            ("thin prism", fisheye([0.03, -0.01, 0.002, 0.0, 0.0, 0.0], [1e-3, 2e-3], [1e-3, 0.0, -2e-3, 0.0], false)),
            ("aria", fisheye([0.05, -0.02, 0.01, -0.003, 4e-4, -1e-5], [1e-3, -1e-3], [2e-3, 1e-4, -1e-3, 2e-4], true)),
            ("field of view", Distortion::Angular { omega: 0.9 }),
            ("barrel by division", Distortion::Division { k: -0.3 }),
            ("pincushion by division", Distortion::Division { k: 0.2 }),
            ("unified", Distortion::Unified { alpha: 0.6, beta: 1.1 }),
        ]
    }

    #[test]
    fn every_lens_is_inverted_over_its_picture() {
        for (name, distortion) in lenses() {
            let lens = Lens { focal: DVec2::new(310.0, 300.0), principal: DVec2::new(163.0, 118.0), distortion };
            for y in 0..13 {
                for x in 0..17 {
                    let pixel = DVec2::new(f64::from(20 * x), f64::from(20 * y));
                    let point = lens.direction_of(pixel).unwrap_or_else(|| panic!("{name} at {pixel}"));
                    let back = lens.pixel_of(point);
                    assert!((back - pixel).length() < 1e-6, "{name}: {pixel} came back as {back}");
                }
            }
        }
    }

    #[test]
    fn a_direction_at_45_degrees_falls_where_the_formulas_say() {
        let point = DVec2::new(1.0, 0.0);
        let quarter = std::f64::consts::FRAC_PI_4;
        let distorted = |distortion: Distortion| distortion.distorted(point).x;
        let radial = Distortion::opencv([-0.1, 0.01, 0.0, 0.0, 0.0, 0.0], [0.0; 2]);
        assert!((distorted(radial) - 0.91).abs() < 1e-12);
        // Different, so that none stands for another.
        let all = Distortion::Perspective {
            numerator: [0.1, 0.2, 0.3, 0.4],
            denominator: [0.5, 0.25, 0.125],
            tangential: [0.0; 2],
        };
        assert!((all.distorted(DVec2::new(2.0, 0.0)).x - 2.0 * 126.2 / 15.0).abs() < 1e-12);
        let tangential = Distortion::opencv([0.0; 6], [0.1, 0.01]);
        assert!((tangential.distorted(point) - DVec2::new(1.03, 0.1)).length() < 1e-12);
        let fisheye = Distortion::Fisheye {
            radial: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
            tangential: [0.0; 2],
            prism: [0.0; 4],
            shifted_last: false,
        };
        assert!((distorted(fisheye) - quarter * (1.0 + 0.1 * quarter * quarter)).abs() < 1e-12);
        let omega = 1.2;
        assert!((distorted(Distortion::Angular { omega }) - (2.0 * (0.6f64).tan()).atan() / omega).abs() < 1e-12);
        // 0.8 / (1 + k 0.64) is 1 for k = -0.3125.
        assert!((distorted(Distortion::Division { k: -0.312_5 }) - 0.8).abs() < 1e-12);
        assert!((distorted(Distortion::Unified { alpha: 0.5, beta: 3.0 }) - 1.0 / 1.5).abs() < 1e-12);
    }

    #[test]
    fn what_lies_beside_or_behind_the_camera_has_no_direction() {
        let distortion =
            Distortion::Fisheye { radial: [0.0; 6], tangential: [0.0; 2], prism: [0.0; 4], shifted_last: false };
        let lens = Lens { focal: DVec2::splat(100.0), principal: DVec2::ZERO, distortion };
        assert!(lens.direction_of(DVec2::new(156.0, 0.0)).is_some());
        assert!(lens.direction_of(DVec2::new(158.0, 0.0)).is_none());
        for (distortion, edge) in
            [(Distortion::Division { k: -1.0 }, 100.0), (Distortion::Unified { alpha: 1.0, beta: 1.0 }, 100.0)]
        {
            let lens = Lens { distortion, ..lens };
            assert!(lens.direction_of(DVec2::new(edge - 0.1, 0.0)).is_some());
            assert!(lens.direction_of(DVec2::new(edge + 0.1, 0.0)).is_none());
        }
        // A barrel so strong that the image folds back.
        let folded = Distortion::opencv([-0.5, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]);
        assert!(Lens { distortion: folded, ..lens }.direction_of(DVec2::new(90.0, 0.0)).is_none());
    }
}
