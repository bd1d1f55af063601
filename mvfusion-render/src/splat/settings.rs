//! The settings of a render: the rules of the rasteriser, the SH degree, and the channels of the statistic.

use mvfusion_kernels::splat::MIN_ALPHA;

use super::SplatError;

/// The extent of a Gaussian on the image plane, which determines its radius and its tiles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Extent {
    /// A square whose half side is this many standard deviations of the longest axis, with the tile arithmetic of 3DGS.
    Square {
        /// Standard deviations, above 0.
        sigmas: f64,
    },
    /// A rectangle whose half sides are this many standard deviations along x and along y.
    PerAxis {
        /// Standard deviations, above 0.
        sigmas: f64,
    },
}

/// The bounds of the tangents `x / z`, `y / z` in the Jacobian of the projection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TangentClamp {
    /// 1.3 times the tangent of half the field of view on either side of the viewing direction.
    AroundAxis,
    /// 0.15 image widths (heights) beyond the borders, wherever the principal point is.
    AroundPicture,
}

/// Gradient of a clamped alpha.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClampGradient {
    /// The gradient without the clamp.
    StraightThrough,
    /// No gradient.
    Zero,
}

/// When a pixel counts as opaque. A Gaussian that would reach this transmittance, which is above 0, is not added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stop {
    /// Below this transmittance.
    Below(f64),
    /// At this transmittance or below.
    AtOrBelow(f64),
}

/// Whether the opacity is compensated for the dilation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Antialias {
    /// The opacity is unchanged.
    Off,
    /// The opacity is multiplied by `sqrt(max(det / det of the dilated covariance, 0.005²))`.
    Compensated,
}

/// Rules of a rasteriser (METHOD §8). The named presets are [`SplatRules::inria`] and [`SplatRules::gsplat`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatRules {
    /// Gaussians at this z in camera coordinates or nearer are culled; 0 or more.
    pub near: f64,
    /// Gaussians at this z or farther are culled; above `near`.
    pub far: f64,
    /// Added to the z that divides the centre's position; 0 or more.
    pub depth_guard: f64,
    /// Added to both diagonal entries of the covariance on the image plane, in square pixels; 0 or more.
    pub dilation: f64,
    /// Largest alpha of one Gaussian at one pixel, above 0. Its difference from 1 does not reach the transmittance of
    /// `stop`: otherwise, an opaque Gaussian would not be added to an empty pixel.
    pub alpha_clamp: f64,
    /// Gradient of a clamped alpha.
    pub clamp_gradient: ClampGradient,
    /// When a pixel is finished.
    pub stop: Stop,
    /// Extent of a Gaussian.
    pub extent: Extent,
    /// Bounds of the Jacobian's tangents.
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

    /// The rules of gsplat, with its current alpha clamp of 0.99 (formerly 0.999), without antialiasing.
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

    /// Whether an opaque Gaussian is added to an empty pixel, with the arithmetic of both precisions. The sum of both
    /// numbers would round to 1.
    fn shows_opaque(&self) -> bool {
        let (behind, behind_single) = (1.0 - self.alpha_clamp, 1.0 - self.alpha_clamp as f32);
        match self.stop {
            Stop::Below(stop) => behind >= stop && behind_single >= stop as f32,
            Stop::AtOrBelow(stop) => behind > stop && behind_single > stop as f32,
        }
    }

    /// Checks the ranges of the fields. NaN is out of all of them.
    pub(super) fn check(&self) -> Result<(), SplatError> {
        let (Stop::Below(stop) | Stop::AtOrBelow(stop)) = self.stop;
        let (Extent::Square { sigmas } | Extent::PerAxis { sigmas }) = self.extent;
        let ranges = [
            ("near", self.near, self.near >= 0.0, "0 or more, because nothing behind the camera is seen"),
            ("far", self.far, self.far as f32 > self.near as f32, "a number above `near`, also in single precision"),
            ("depth_guard", self.depth_guard, self.depth_guard >= 0.0, "0 or more"),
            ("dilation", self.dilation, self.dilation >= 0.0, "0 or more"),
            ("stop", stop, stop as f32 > 0.0, "a number above 0, also in single precision"),
            ("extent", sigmas, sigmas as f32 > 0.0, "more than 0 standard deviations, also in single precision"),
            (
                "alpha_clamp",
                self.alpha_clamp,
                self.alpha_clamp as f32 >= MIN_ALPHA as f32 && self.shows_opaque(),
                "a number from 1/255 whose difference from 1 does not reach `stop`, also in single precision",
            ),
        ];
        match ranges.into_iter().find(|(.., is_valid, _)| !is_valid) {
            Some((rule, value, _, expected)) => Err(SplatError::Rule { rule, value, expected }),
            None => Ok(()),
        }
    }
}

impl Default for SplatRules {
    fn default() -> Self {
        Self::inria()
    }
}

/// The cotangents of the `main` image that enter the statistic, which is the gradient of the probe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Statistic {
    /// Colour, alpha and depth: the channels of the colour pass of a separate rasteriser.
    #[default]
    ColourAndDepth,
    /// Colour, alpha, depth and the extra features.
    AllChannels,
}

/// Settings of a render.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatSettings {
    /// The rasteriser's rules.
    pub rules: SplatRules,
    /// SH degree to evaluate, 0 to 3.
    pub sh_degree: usize,
    /// Channels of the statistic.
    pub statistic: Statistic,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rule that is refused, if any.
    fn refused(alpha_clamp: f64, stop: Stop) -> Option<&'static str> {
        match (SplatRules { alpha_clamp, stop, ..SplatRules::inria() }).check() {
            Err(SplatError::Rule { rule, .. }) => Some(rule),
            _ => None,
        }
    }

    #[test]
    fn an_opaque_gaussian_is_added_to_an_empty_pixel_in_both_precisions() {
        // Sums that round to 1 in f64, a clamp that is 1 in f32, and a transmittance that is 0 there.
        assert_eq!(refused(1.0, Stop::Below(1e-17)), Some("alpha_clamp"));
        assert_eq!(refused(0.999_999_99, Stop::Below(1e-9)), Some("alpha_clamp"));
        assert_eq!(refused(1.0, Stop::Below(1e-50)), Some("stop"));
        assert_eq!(refused(f64::NAN, Stop::Below(1e-4)), Some("alpha_clamp"));
        assert_eq!(refused(0.5, Stop::Below(f64::NAN)), Some("stop"));
        // What is exactly reached counts for one rule alone.
        assert_eq!(refused(0.75, Stop::Below(0.25)), None);
        assert_eq!(refused(0.75, Stop::AtOrBelow(0.25)), Some("alpha_clamp"));
    }

    #[test]
    fn the_shipped_rules_are_valid() {
        for rules in [SplatRules::inria(), SplatRules::gsplat()] {
            for antialias in [Antialias::Off, Antialias::Compensated] {
                assert!((SplatRules { antialias, ..rules }).check().is_ok(), "{rules:?}");
            }
            assert!((SplatRules { alpha_clamp: 0.999, ..rules }).check().is_ok(), "the former clamp of gsplat");
        }
    }
}
