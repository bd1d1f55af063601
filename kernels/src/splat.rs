//! Sizes, thresholds and record layouts of the splat op. Code addresses record fields, blended channels and image
//! planes by these names, never by bare numbers.

/// Width and height of a tile in pixels.
pub const TILE: usize = 16;
/// Pixels of a tile.
pub const TILE_PIXELS: usize = TILE * TILE;
/// Smallest alpha at which a Gaussian contributes to a pixel.
pub const MIN_ALPHA: f64 = 1.0 / 255.0;
/// Smallest norm of a valid quaternion (the epsilon of the usual normalisation).
pub const MIN_QUATERNION_NORM: f64 = 1e-12;
/// Lower bound of the factor that compensates the opacity for the dilation.
pub const MIN_COMPENSATION: f64 = 0.005;
/// Lower bound of the determinant of a covariance on the image plane.
pub const MIN_DETERMINANT: f64 = 1e-10;
/// Lower bound of 3DGS under the square root in the larger eigenvalue.
pub const MIN_EIGENVALUE_SPREAD: f64 = 0.1;
/// Slack on the reach. It covers the rounding of logarithm and exponential in single precision.
pub const REACH_SLACK: f64 = 1e-4;
/// Rounding error that the ellipse-box test allows for, in units of half the machine epsilon.
pub const TOUCH_ROUNDINGS: f64 = 8.0;
/// Farthest centre on a GPU, in pixels from the first one: beyond any image, and small enough for arithmetic in 32 bits.
pub const MAX_CENTRE: i32 = 1 << 28;
/// Largest radius on a GPU, in pixels. It reaches the image from the farthest centre.
pub const MAX_RADIUS: i32 = 1 << 29;

/// Number of colour channels. They are the first blended channels; the extra features follow, then the depth.
pub const COLOUR_CHANNELS: usize = 3;

/// Number of blended channels for a number of extra features: colour, features, depth.
pub const fn channel_count(features: usize) -> usize {
    COLOUR_CHANNELS + features + 1
}

/// Number of extra features among the blended channels.
pub const fn feature_count(channels: usize) -> usize {
    channels - COLOUR_CHANNELS - 1
}

/// Number of channels that have a background: all but the depth.
pub const fn background_channels(channels: usize) -> usize {
    channels - 1
}

/// Index of the depth among the blended channels: the last.
pub const fn depth_channel(channels: usize) -> usize {
    channels - 1
}

/// Number of planes in one copy of the packed image: colour, features, alpha, depth.
pub const fn plane_count(channels: usize) -> usize {
    channels + 1
}

/// Index of the alpha plane. Alpha is not a blended channel; the depth plane follows it.
pub const fn alpha_plane(channels: usize) -> usize {
    channels - 1
}

/// Index of the plane of a blended channel.
pub const fn plane_of_channel(channel: usize, channels: usize) -> usize {
    if channel < alpha_plane(channels) { channel } else { channel + 1 }
}

/// Length of the stored row of a [`Projected`].
pub const PROJECTED_LEN: usize = projected_row::BLUE + 1;

/// Indices of the fields of a [`Projected`] in its stored row.
pub mod projected_row {
    /// Centre along x.
    pub const CENTRE_X: usize = 0;
    /// Centre along y.
    pub const CENTRE_Y: usize = 1;
    /// Curvature along x.
    pub const CURVE_X: usize = 2;
    /// Shear.
    pub const SLOPE: usize = 3;
    /// Curvature that remains along y.
    pub const CURVE_Y: usize = 4;
    /// Opacity.
    pub const OPACITY: usize = 5;
    /// Largest visible sigma.
    pub const REACH: usize = 6;
    /// Depth.
    pub const DEPTH: usize = 7;
    /// Red, the first of the [`COLOUR_CHANNELS`](super::COLOUR_CHANNELS).
    pub const RED: usize = 8;
    /// Green.
    pub const GREEN: usize = 9;
    /// Blue.
    pub const BLUE: usize = 10;
}

/// A Gaussian on the image plane, with everything that blending needs except its features.
///
/// The exponent at a pixel `d = pixel - centre` is a sum of two squares:
/// `sigma = (curve_x (dx + slope dy)² + curve_y dy²) / 2`. Here `curve_x = a`, `slope = b / a` and
/// `curve_y = c - b² / a = 1 / covariance_yy` for the conic `(a, b, c)`. In single precision this form can neither
/// cancel nor become negative, unlike `a dx² / 2 + b dx dy + c dy² / 2`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Projected<T> {
    /// Centre in pixels; the centre of the first pixel is at 0.5.
    pub centre: [T; 2],
    /// Curvature along x at a fixed y: the conic's first entry.
    pub curve_x: T,
    /// Shear of the ellipse: the offset of its axis along -x per step in y.
    pub slope: T,
    /// Curvature that remains along y: the inverse of the covariance's yy entry.
    pub curve_y: T,
    /// Opacity in `[0, 1]`, compensated if the rules require it.
    pub opacity: T,
    /// Largest sigma at which alpha reaches [`MIN_ALPHA`], with a little slack; not positive if alpha never reaches it.
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
        use projected_row::*;
        Self {
            centre: [row[CENTRE_X], row[CENTRE_Y]],
            curve_x: row[CURVE_X],
            slope: row[SLOPE],
            curve_y: row[CURVE_Y],
            opacity: row[OPACITY],
            reach: row[REACH],
            depth: row[DEPTH],
            colour: [row[RED], row[GREEN], row[BLUE]],
        }
    }

    /// The row to store.
    #[inline(always)]
    pub fn to_row(self) -> [T; PROJECTED_LEN] {
        use projected_row::*;
        // The fill is arbitrary: every element is overwritten.
        let mut row = [self.depth; PROJECTED_LEN];
        [row[CENTRE_X], row[CENTRE_Y]] = self.centre;
        row[CURVE_X] = self.curve_x;
        row[SLOPE] = self.slope;
        row[CURVE_Y] = self.curve_y;
        row[OPACITY] = self.opacity;
        row[REACH] = self.reach;
        row[DEPTH] = self.depth;
        [row[RED], row[GREEN], row[BLUE]] = self.colour;
        row
    }
}

/// Length of a [`ProjectedGradient`]: the part of a gradient record before its channels.
pub const PROJECTED_GRADIENT_LEN: usize = gradient_record::STATISTIC_Y + 1;

/// Indices in a gradient record: the fields of a [`ProjectedGradient`], then the blended channels.
pub mod gradient_record {
    use super::{COLOUR_CHANNELS, PROJECTED_GRADIENT_LEN, depth_channel};

    /// Centre along x.
    pub const CENTRE_X: usize = 0;
    /// Centre along y.
    pub const CENTRE_Y: usize = 1;
    /// The whitened covariance's xx entry.
    pub const WHITENED_XX: usize = 2;
    /// The whitened covariance's xy entry.
    pub const WHITENED_XY: usize = 3;
    /// The whitened covariance's yy entry.
    pub const WHITENED_YY: usize = 4;
    /// Opacity.
    pub const OPACITY: usize = 5;
    /// The part of the centre's gradient along x that enters the statistic.
    pub const STATISTIC_X: usize = 6;
    /// The part of the centre's gradient along y that enters the statistic.
    pub const STATISTIC_Y: usize = 7;
    /// The first channel.
    pub const CHANNELS: usize = PROJECTED_GRADIENT_LEN;
    /// Red.
    pub const RED: usize = CHANNELS;
    /// Green.
    pub const GREEN: usize = CHANNELS + 1;
    /// Blue.
    pub const BLUE: usize = CHANNELS + 2;
    /// The first extra feature.
    pub const FEATURES: usize = CHANNELS + COLOUR_CHANNELS;

    /// The depth, the last of the channels.
    pub const fn depth(channels: usize) -> usize {
        CHANNELS + depth_channel(channels)
    }

    /// Length of a record.
    pub const fn len(channels: usize) -> usize {
        CHANNELS + channels
    }
}

/// Gradient with respect to a projected Gaussian: the head of a gradient record. The channels follow it (colour,
/// features, depth).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProjectedGradient<T> {
    /// With respect to the centre in pixels.
    pub centre: [T; 2],
    /// With respect to the xx, xy and yy entries of `W C Wᵀ`, the covariance in whitened coordinates; xy counts for both
    /// off-diagonal entries. `W = [[√curve_x, √curve_x slope], [0, √curve_y]]` makes sigma `|W d|² / 2`.
    ///
    /// These are as large as sigma. The gradient with respect to `C` itself is as large as one over the smaller eigenvalue
    /// of `C`, and is multiplied by the larger one later: a long, thin Gaussian would be left without a correct digit.
    pub whitened: [T; 3],
    /// With respect to the (compensated) opacity.
    pub opacity: T,
    /// The part of `centre` that enters the statistic.
    pub statistic: [T; 2],
}

impl<T: Copy> ProjectedGradient<T> {
    /// Reads the head of a gradient record.
    #[inline(always)]
    pub fn from_row(row: &[T; PROJECTED_GRADIENT_LEN]) -> Self {
        use gradient_record::*;
        Self {
            centre: [row[CENTRE_X], row[CENTRE_Y]],
            whitened: [row[WHITENED_XX], row[WHITENED_XY], row[WHITENED_YY]],
            opacity: row[OPACITY],
            statistic: [row[STATISTIC_X], row[STATISTIC_Y]],
        }
    }

    /// The head of the record to store.
    #[inline(always)]
    pub fn to_row(self) -> [T; PROJECTED_GRADIENT_LEN] {
        use gradient_record::*;
        // The fill is arbitrary: every element is overwritten.
        let mut row = [self.opacity; PROJECTED_GRADIENT_LEN];
        [row[CENTRE_X], row[CENTRE_Y]] = self.centre;
        [row[WHITENED_XX], row[WHITENED_XY], row[WHITENED_YY]] = self.whitened;
        row[OPACITY] = self.opacity;
        [row[STATISTIC_X], row[STATISTIC_Y]] = self.statistic;
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row in which each value is its own index.
    fn indices<const N: usize>() -> [usize; N] {
        std::array::from_fn(|index| index)
    }

    #[test]
    fn each_field_of_a_projected_gaussian_has_its_named_index() {
        let splat = Projected::from_row(&indices());
        assert_eq!(splat.centre, [projected_row::CENTRE_X, projected_row::CENTRE_Y]);
        assert_eq!(splat.curve_x, projected_row::CURVE_X);
        assert_eq!(splat.slope, projected_row::SLOPE);
        assert_eq!(splat.curve_y, projected_row::CURVE_Y);
        assert_eq!(splat.opacity, projected_row::OPACITY);
        assert_eq!(splat.reach, projected_row::REACH);
        assert_eq!(splat.depth, projected_row::DEPTH);
        assert_eq!(splat.colour, [projected_row::RED, projected_row::GREEN, projected_row::BLUE]);
        assert_eq!(splat.colour, std::array::from_fn(|channel| projected_row::RED + channel));
        assert_eq!(splat.to_row(), indices());
    }

    #[test]
    fn each_field_of_a_gradient_has_its_named_index_and_the_channels_follow() {
        let gradient = ProjectedGradient::from_row(&indices());
        assert_eq!(gradient.centre, [gradient_record::CENTRE_X, gradient_record::CENTRE_Y]);
        let whitened = [gradient_record::WHITENED_XX, gradient_record::WHITENED_XY, gradient_record::WHITENED_YY];
        assert_eq!(gradient.whitened, whitened);
        assert_eq!(gradient.opacity, gradient_record::OPACITY);
        assert_eq!(gradient.statistic, [gradient_record::STATISTIC_X, gradient_record::STATISTIC_Y]);
        assert_eq!(gradient.to_row(), indices());

        let channels = channel_count(2);
        let colour = [gradient_record::RED, gradient_record::GREEN, gradient_record::BLUE];
        assert_eq!(colour, std::array::from_fn(|channel| PROJECTED_GRADIENT_LEN + channel));
        assert_eq!(gradient_record::FEATURES, PROJECTED_GRADIENT_LEN + COLOUR_CHANNELS);
        assert_eq!(gradient_record::depth(channels), gradient_record::FEATURES + feature_count(channels));
        assert_eq!(gradient_record::len(channels), gradient_record::depth(channels) + 1);
    }

    #[test]
    fn the_planes_of_a_picture_are_colour_features_alpha_and_depth() {
        let channels = channel_count(2);
        assert_eq!(feature_count(channels), 2);
        let planes: Vec<usize> = (0..channels).map(|channel| plane_of_channel(channel, channels)).collect();
        assert_eq!(planes, [0, 1, 2, 3, 4, 6]);
        assert_eq!((alpha_plane(channels), plane_count(channels)), (5, 7));
        assert_eq!((background_channels(channels), depth_channel(channels)), (5, 5));
    }
}
