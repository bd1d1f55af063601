//! Sizes, thresholds and record layouts of the splat op.

/// Width and height of a tile in pixels.
pub const TILE: usize = 16;
/// Pixels of a tile.
pub const TILE_PIXELS: usize = TILE * TILE;
/// A Gaussian that covers a pixel with less than this alpha is skipped there.
pub const MIN_ALPHA: f64 = 1.0 / 255.0;
/// Colour channels, which lead the blended channels; the extra features follow, then the depth.
pub const COLOUR_CHANNELS: usize = 3;
/// Smallest norm of a quaternion that still names a rotation (the epsilon of the usual normalisation).
pub const MIN_QUATERNION_NORM: f64 = 1e-12;
/// Smallest factor that compensates the opacity for the dilation.
pub const MIN_COMPENSATION: f64 = 0.005;
/// Smallest determinant of a covariance on the picture plane.
pub const MIN_DETERMINANT: f64 = 1e-10;
/// 3DGS's lower bound under the root of the larger eigenvalue.
pub const MIN_EIGENVALUE_SPREAD: f64 = 0.1;
/// Slack on the reach, which covers rounding of the logarithm and of the exponential in single precision.
pub const REACH_SLACK: f64 = 1e-4;
/// Roundings that the test of an ellipse against a box allows for, in halves of the precision's epsilon.
pub const TOUCH_ROUNDINGS: f64 = 8.0;
/// Largest radius that a GPU gives, in pixels: beyond any picture, and small enough to reckon with in 32 bits.
pub const MAX_RADIUS: i32 = 1 << 28;

/// Numbers in the stored row of a [`Projected`].
pub const PROJECTED_LEN: usize = 11;

/// A Gaussian on the picture plane: what blending needs of it beside its features.
///
/// The exponent at a pixel `d = pixel - centre` is written as a sum of two squares, which can neither cancel nor turn
/// negative in single precision, unlike `a dx² / 2 + b dx dy + c dy² / 2` with the same conic `(a, b, c)`:
/// `sigma = (curve_x (dx + slope dy)² + curve_y dy²) / 2`, where `curve_x = a`, `slope = b / a` and
/// `curve_y = c - b² / a = 1 / covariance_yy`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Projected<T> {
    /// Centre in pixels; the centre of the first pixel lies at 0.5.
    pub centre: [T; 2],
    /// Curvature along x at a fixed y: the conic's first entry.
    pub curve_x: T,
    /// Shear of the ellipse: how far its axis moves against x for a step in y.
    pub slope: T,
    /// Curvature that remains along y: the inverse of the covariance's yy entry.
    pub curve_y: T,
    /// Opacity in `[0, 1]`, compensated if the rules ask for it.
    pub opacity: T,
    /// Largest sigma at which alpha reaches [`MIN_ALPHA`], with a little slack; not positive if it nowhere does.
    pub reach: T,
    /// z in camera coordinates.
    pub depth: T,
    /// Colour seen from the camera, not negative.
    pub colour: [T; 3],
}

impl<T: Copy> Projected<T> {
    /// Reads a stored row of [`PROJECTED_LEN`] numbers.
    #[inline(always)]
    pub fn from_row(row: &[T; PROJECTED_LEN]) -> Self {
        let [x, y, curve_x, slope, curve_y, opacity, reach, depth, red, green, blue] = *row;
        Self { centre: [x, y], curve_x, slope, curve_y, opacity, reach, depth, colour: [red, green, blue] }
    }

    /// The row to store.
    #[inline(always)]
    pub fn to_row(self) -> [T; PROJECTED_LEN] {
        let ([x, y], [red, green, blue]) = (self.centre, self.colour);
        [x, y, self.curve_x, self.slope, self.curve_y, self.opacity, self.reach, self.depth, red, green, blue]
    }
}

/// Numbers of a [`ProjectedGradient`] before its channels.
pub const PROJECTED_GRADIENT_LEN: usize = 8;

/// Gradient with respect to a projected Gaussian: the head of a gradient record, which its channels follow
/// (colour, features, depth).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProjectedGradient<T> {
    /// With respect to the centre in pixels.
    pub centre: [T; 2],
    /// With respect to the covariance's xx, xy and yy entries; xy counts for both off-diagonal entries.
    pub covariance: [T; 3],
    /// With respect to the (compensated) opacity.
    pub opacity: T,
    /// The share of `centre` that the statistic counts.
    pub statistic: [T; 2],
}

impl<T: Copy> ProjectedGradient<T> {
    /// Reads the head of a gradient record.
    #[inline(always)]
    pub fn from_row(row: &[T; PROJECTED_GRADIENT_LEN]) -> Self {
        let [x, y, xx, xy, yy, opacity, statistic_x, statistic_y] = *row;
        Self { centre: [x, y], covariance: [xx, xy, yy], opacity, statistic: [statistic_x, statistic_y] }
    }

    /// The head of the record to store.
    #[inline(always)]
    pub fn to_row(self) -> [T; PROJECTED_GRADIENT_LEN] {
        let ([x, y], [xx, xy, yy], [statistic_x, statistic_y]) = (self.centre, self.covariance, self.statistic);
        [x, y, xx, xy, yy, self.opacity, statistic_x, statistic_y]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_projected_gaussian_survives_its_row() {
        let row: [i32; PROJECTED_LEN] = std::array::from_fn(|i| i as i32);
        assert_eq!(Projected::from_row(&row).to_row(), row);
        let row: [i32; PROJECTED_GRADIENT_LEN] = std::array::from_fn(|i| i as i32);
        assert_eq!(ProjectedGradient::from_row(&row).to_row(), row);
    }
}
