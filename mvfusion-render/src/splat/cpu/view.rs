//! The camera and the rules in the precision of the computation, with all values that Gaussians share.

use mvfusion_data::Camera;
use mvfusion_kernels::splat::TILE;

use super::lanes::Lane;
use crate::splat::settings::{Antialias, ClampGradient, Extent, SplatSettings, Stop, TangentClamp};

/// A camera and rules with precomputed values.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View<T> {
    /// Image size in pixels.
    pub width: usize,
    pub height: usize,
    /// Focal lengths and principal point in pixels.
    pub focal: [T; 2],
    pub principal: [T; 2],
    /// Rotation from world to camera, in rows.
    pub rotation: [[T; 3]; 3],
    pub translation: [T; 3],
    /// Centre of the camera in world coordinates.
    pub centre: [T; 3],
    /// Bounds of the tangents in the Jacobian.
    pub tangent_low: [T; 2],
    pub tangent_high: [T; 2],
    pub near: T,
    pub far: T,
    pub depth_guard: T,
    pub dilation: T,
    pub alpha_clamp: T,
    /// Largest `opacity * exp(-sigma)` with a gradient.
    pub gradient_clamp: T,
    /// A pixel is finished when its transmittance would fall below this value.
    pub stop: T,
    pub extent: Extent,
    pub antialias: Antialias,
    pub sh_degree: usize,
}

impl<T: Lane> View<T> {
    /// Prepares a camera and settings.
    pub fn new(camera: &Camera, settings: &SplatSettings) -> Self {
        let rules = &settings.rules;
        let rows = [camera.rotation.row(0), camera.rotation.row(1), camera.rotation.row(2)];
        let sizes = [camera.width as f64, camera.height as f64];
        let (focal, principal) = ([camera.fx, camera.fy], [camera.cx, camera.cy]);
        let bounds = [0, 1].map(|axis| tangent_bounds(rules.tangent_clamp, sizes[axis], focal[axis], principal[axis]));
        Self {
            width: camera.width,
            height: camera.height,
            focal: focal.map(T::of),
            principal: principal.map(T::of),
            rotation: rows.map(|row| row.to_array().map(T::of)),
            translation: camera.translation.to_array().map(T::of),
            centre: camera.centre().to_array().map(T::of),
            tangent_low: bounds.map(|b| T::of(b[0])),
            tangent_high: bounds.map(|b| T::of(b[1])),
            near: T::of(rules.near),
            far: T::of(rules.far),
            depth_guard: T::of(rules.depth_guard),
            dilation: T::of(rules.dilation),
            alpha_clamp: T::of(rules.alpha_clamp),
            gradient_clamp: match rules.clamp_gradient {
                ClampGradient::StraightThrough => T::infinity(),
                ClampGradient::Zero => T::of(rules.alpha_clamp),
            },
            stop: match rules.stop {
                Stop::Below(threshold) => T::of(threshold),
                Stop::AtOrBelow(threshold) => T::of(threshold).next_above(),
            },
            extent: rules.extent,
            antialias: rules.antialias,
            sh_degree: settings.sh_degree,
        }
    }

    /// Number of columns and rows of tiles.
    pub fn grid(&self) -> [usize; 2] {
        [self.width.div_ceil(TILE), self.height.div_ceil(TILE)]
    }

    /// Number of tiles.
    pub fn tile_count(&self) -> usize {
        let [columns, rows] = self.grid();
        columns * rows
    }
}

fn tangent_bounds(clamp: TangentClamp, size: f64, focal: f64, principal: f64) -> [f64; 2] {
    let margin = 0.15 * size / focal;
    match clamp {
        TangentClamp::AroundAxis => [-1.3 * 0.5 * size / focal, 1.3 * 0.5 * size / focal],
        TangentClamp::AroundPicture => [-(principal / focal + margin), (size - principal) / focal + margin],
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::splat::SplatRules;

    #[test]
    fn the_two_tangent_clamps_agree_for_a_centred_principal_point() {
        let camera = Camera::centred(64, 48, 50.0, DMat3::IDENTITY, DVec3::ZERO);
        let view = |rules| View::<f64>::new(&camera, &SplatSettings { rules, ..Default::default() });
        let (inria, gsplat) = (view(SplatRules::inria()), view(SplatRules::gsplat()));
        for axis in 0..2 {
            assert!((inria.tangent_low[axis] - gsplat.tangent_low[axis]).abs() < 1e-12);
            assert!((inria.tangent_high[axis] - gsplat.tangent_high[axis]).abs() < 1e-12);
        }
    }

    #[test]
    fn a_picture_of_any_size_is_covered_by_tiles() {
        let camera = Camera::centred(33, 16, 50.0, DMat3::IDENTITY, DVec3::ZERO);
        assert_eq!(View::<f32>::new(&camera, &SplatSettings::default()).grid(), [3, 1]);
    }
}
