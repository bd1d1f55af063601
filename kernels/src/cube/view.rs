//! The camera and the rules as the kernels take them.

use cubecl::prelude::*;

use super::maths::{Pair, Triple};

/// A camera and the rules' numbers; the CPU twin's `View`.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct View {
    /// Picture size in pixels.
    pub width: u32,
    /// See `width`.
    pub height: u32,
    /// Focal lengths in pixels.
    pub focal: Pair,
    /// Principal point in pixels.
    pub principal: Pair,
    /// World to camera, first row of the rotation.
    pub right: Triple,
    /// Second row.
    pub down: Triple,
    /// Third row.
    pub forward: Triple,
    /// World to camera.
    pub translation: Triple,
    /// Centre of the camera in the world.
    pub centre: Triple,
    /// Lower bounds of the tangents in the Jacobian.
    pub tangent_low: Pair,
    /// Upper bounds.
    pub tangent_high: Pair,
    /// Gaussians at this depth or before it are culled.
    pub near: f32,
    /// Gaussians at this depth or beyond it are culled.
    pub far: f32,
    /// Added to the depth where it divides the centre's position.
    pub depth_guard: f32,
    /// Added to the covariance's diagonal.
    pub dilation: f32,
    /// How many standard deviations a Gaussian reaches.
    pub sigmas: f32,
}

/// The rules' numbers that blending needs.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct BlendRules {
    /// Largest alpha of one Gaussian at one pixel.
    pub alpha_clamp: f32,
    /// Largest `opacity * exp(-sigma)` whose alpha passes a gradient.
    pub gradient_clamp: f32,
    /// A transmittance below this finishes a pixel.
    pub stop: f32,
}

/// What a kernel is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ProjectionKind {
    /// Whether a Gaussian reaches as far along x as along y, in the tile arithmetic of 3DGS.
    pub square: bool,
    /// Whether the opacity is compensated for the dilation.
    pub compensated: bool,
    /// Degree of the spherical harmonics.
    pub degree: usize,
}
