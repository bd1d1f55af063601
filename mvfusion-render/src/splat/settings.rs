//! What a picture is rendered by: the rules of the rasteriser, the degree of the colours, and what the statistic counts.

/// How far a Gaussian reaches on the picture plane, from which its radius and its tiles follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extent {
    /// A square whose half side is this many standard deviations of the longest axis, in the tile arithmetic of 3DGS.
    Square {
        /// Standard deviations.
        sigmas: f64,
    },
    /// A rectangle whose half sides are this many standard deviations along x and along y.
    PerAxis {
        /// Standard deviations.
        sigmas: f64,
    },
}

/// Where the tangents `x / z`, `y / z` are cut off in the Jacobian of the projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TangentClamp {
    /// At 1.3 times the tangent of half the field of view to either side of the viewing direction.
    AroundAxis,
    /// At 0.15 picture widths (heights) beyond the borders, wherever the principal point lies.
    AroundPicture,
}

/// Gradient of an alpha that the clamp holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClampGradient {
    /// As if the clamp were not there.
    StraightThrough,
    /// None.
    Zero,
}

/// When a pixel counts as opaque: a Gaussian that would bring the transmittance there is not added any more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stop {
    /// Below this transmittance.
    Below(f64),
    /// At this transmittance or below.
    AtOrBelow(f64),
}

/// Whether the opacity pays for the widening of the Gaussian by the dilation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Antialias {
    /// The opacity stays as it is.
    Off,
    /// The opacity is multiplied by `sqrt(max(det / det of the dilated covariance, 0.005²))`.
    Compensated,
}

/// Rules of a rasteriser (METHOD §8). The named presets are [`SplatRules::inria`] and [`SplatRules::gsplat`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatRules {
    /// Gaussians at this z in camera coordinates or before it are culled.
    pub near: f64,
    /// Gaussians at this z or beyond it are culled.
    pub far: f64,
    /// Added to z where it divides the centre's position.
    pub depth_guard: f64,
    /// Added to both diagonal entries of the covariance on the picture plane, in square pixels.
    pub dilation: f64,
    /// Largest alpha of one Gaussian at one pixel.
    pub alpha_clamp: f64,
    /// Gradient of an alpha that the clamp holds.
    pub clamp_gradient: ClampGradient,
    /// When a pixel is finished.
    pub stop: Stop,
    /// How far a Gaussian reaches.
    pub extent: Extent,
    /// Where the Jacobian's tangents are cut off.
    pub tangent_clamp: TangentClamp,
    /// Whether the opacity is compensated.
    pub antialias: Antialias,
}

impl SplatRules {
    /// The rules of 3DGS and of DeGauss (METHOD §8), the default.
    pub fn inria() -> Self {
        Self {
            near: 0.2,
            far: f64::INFINITY,
            depth_guard: 1e-7,
            dilation: 0.3,
            alpha_clamp: 0.99,
            clamp_gradient: ClampGradient::StraightThrough,
            stop: Stop::Below(1e-4),
            extent: Extent::Square { sigmas: 3.0 },
            tangent_clamp: TangentClamp::AroundAxis,
            antialias: Antialias::Off,
        }
    }

    /// The rules of gsplat, with its present alpha clamp of 0.99 (it was 0.999), without antialiasing.
    pub fn gsplat() -> Self {
        Self {
            near: 0.01,
            far: 1e10,
            depth_guard: 0.0,
            dilation: 0.3,
            alpha_clamp: 0.99,
            clamp_gradient: ClampGradient::Zero,
            stop: Stop::AtOrBelow(1e-4),
            extent: Extent::PerAxis { sigmas: 3.33 },
            tangent_clamp: TangentClamp::AroundPicture,
            antialias: Antialias::Off,
        }
    }
}

impl Default for SplatRules {
    fn default() -> Self {
        Self::inria()
    }
}

/// Which cotangents of the `main` picture feed the statistic that leaves through the probe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Statistic {
    /// Colour, alpha and depth: what the colour pass of a separate rasteriser would see.
    #[default]
    ColourAndDepth,
    /// These and the extra features.
    AllChannels,
}

/// How to render.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatSettings {
    /// The rasteriser's rules.
    pub rules: SplatRules,
    /// Degree of the spherical harmonics that are evaluated, 0 to 3.
    pub sh_degree: usize,
    /// What the statistic counts.
    pub statistic: Statistic,
}
