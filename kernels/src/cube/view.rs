//! The camera and the rules as kernel arguments.

use cubecl::prelude::*;

use super::maths::{Pair, Triple};

/// A camera and the values of the rules. CPU twin: `View`.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct View {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// Focal lengths in pixels.
    pub focal: Pair,
    /// Principal point in pixels.
    pub principal: Pair,
    /// First row of the rotation from world to camera.
    pub right: Triple,
    /// Second row.
    pub down: Triple,
    /// Third row.
    pub forward: Triple,
    /// Translation from world to camera.
    pub translation: Triple,
    /// Centre of the camera in the world.
    pub centre: Triple,
    /// Lower bounds of the tangents in the Jacobian.
    pub tangent_low: Pair,
    /// Upper bounds.
    pub tangent_high: Pair,
    /// Gaussians at this depth or nearer are culled.
    pub near: f32,
    /// Gaussians at this depth or farther are culled.
    pub far: f32,
    /// Added to the depth that divides the centre's position.
    pub depth_guard: f32,
    /// Added to the covariance's diagonal.
    pub dilation: f32,
    /// Radius of a Gaussian in standard deviations.
    pub sigmas: f32,
}

/// The values of the rules that blending needs.
#[derive(CubeType, CubeLaunch, Clone, Copy)]
pub struct BlendRules {
    /// Largest alpha of one Gaussian at one pixel.
    pub alpha_clamp: f32,
    /// Largest `opacity * exp(-sigma)` with a gradient.
    pub gradient_clamp: f32,
    /// A pixel is finished when its transmittance would fall below this value.
    pub stop: f32,
}

/// Compile-time parameters of the projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ProjectionKind {
    /// Whether a Gaussian has the same radius along x and y, with the tile arithmetic of 3DGS.
    pub square: bool,
    /// Whether the opacity is compensated for the dilation.
    pub compensated: bool,
    /// Degree of the spherical harmonics.
    pub degree: usize,
}
