//! What a Gaussian consists of, and the steps of its numbers.

use serde::{Deserialize, Serialize};

use crate::rest_width;

/// Integers stay within this bound, so that the difference of two of them does not overflow.
const LARGEST: f64 = (1 << 29) as f64;

/// The brightness probability above which the brightness factor has a slope of 37 instead of 1 (METHOD §1.3).
pub(super) const BRIGHTNESS_KNEE: f64 = 0.75;
/// Steps of the brightness above the knee in a step below it.
const ABOVE_KNEE: f64 = 16.0;

/// An attribute of a Gaussian as it is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// The centre, in world units. Its step depends on the scene.
    Mean,
    /// Natural logarithms of the standard deviations along the axes.
    LogScale,
    /// A unit quaternion w, x, y, z. Its sign is that of the smallest change from the keyframe before.
    Rotation,
    /// The opacity in `[0, 1]`.
    Opacity,
    /// The probabilities of the mask in `[0, 1]`: static, dynamic.
    Mask,
    /// The mask's probability of brightness in `[0, 1]`.
    Brightness,
    /// The constant colour coefficients.
    ShDc,
    /// The higher colour coefficients, channels fastest. They do not change over time.
    ShRest,
}

/// Evenly spaced numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UniformQuantizer {
    /// The number that zero stands for.
    pub offset: f64,
    /// The distance of two neighbours.
    pub step: f64,
}

impl Quantity {
    /// All quantities, in the order of files.
    pub const ALL: [Self; 8] = [
        Self::Mean,
        Self::LogScale,
        Self::Rotation,
        Self::Opacity,
        Self::Mask,
        Self::Brightness,
        Self::ShDc,
        Self::ShRest,
    ];

    /// Numbers of a Gaussian at one time.
    pub fn columns(self, sh_degree: usize) -> usize {
        match self {
            Self::Mean | Self::LogScale | Self::ShDc => 3,
            Self::Rotation => 4,
            Self::Mask => 2,
            Self::Opacity | Self::Brightness => 1,
            Self::ShRest => rest_width(sh_degree),
        }
    }

    /// Whether it has a value at each keyframe.
    pub fn moves(self) -> bool {
        self != Self::ShRest
    }

    /// Whether larger steps do little harm. They would make faint Gaussians vanish, and the static branch jump.
    pub fn may_be_coarse(self) -> bool {
        !matches!(self, Self::Opacity | Self::Mask)
    }

    /// Whether only Gaussians with masks have it.
    pub fn is_mask(self) -> bool {
        matches!(self, Self::Mask | Self::Brightness)
    }

    /// Whether neighbours in space have similar values, so that the difference to the Gaussian before is stored.
    pub fn is_smooth_in_space(self) -> bool {
        self == Self::Mean
    }
}

impl UniformQuantizer {
    /// The numbers of a quantity; `position_step` is the step of centres. Halves of the steps bound the errors: 0.8 %
    /// of a size, half a degree of a rotation, half an 8-bit level of opacities, masks and constant colours. Those of the
    /// brightness hold above the knee (`brightness_below_knee` has the others): half a step is 1.2 levels of the static
    /// colour there, because the slope is 37.
    pub fn of(quantity: Quantity, position_step: f64) -> Self {
        let (offset, step) = match quantity {
            Quantity::Mean => (0.0, position_step),
            Quantity::LogScale | Quantity::ShRest => (0.0, 1.0 / 64.0),
            Quantity::Rotation => (0.0, 1.0 / 255.0),
            // Around the middle, so that the integers fit into a byte.
            Quantity::Opacity | Quantity::Mask => (128.0 / 255.0, 1.0 / 255.0),
            Quantity::Brightness => (128.0 / 255.0, 1.0 / (255.0 * ABOVE_KNEE)),
            Quantity::ShDc => (0.0, 1.0 / 128.0),
        };
        Self { offset, step }
    }

    /// The numbers of a brightness that is nowhere above the knee: the slope is 1 there.
    pub(super) fn brightness_below_knee() -> Self {
        let fine = Self::of(Quantity::Brightness, 0.0);
        Self { step: ABOVE_KNEE * fine.step, ..fine }
    }

    /// The same numbers with steps that are this many times as large. At least 1.
    pub fn coarser(self, times: u32) -> Self {
        Self { step: f64::from(times.max(1)) * self.step, ..self }
    }

    /// The nearest integer. A number that is not finite becomes zero.
    pub fn quantise(self, value: f64) -> i32 {
        let steps = ((value - self.offset) / self.step).round();
        // NaN becomes 0.
        steps.clamp(-LARGEST, LARGEST) as i32
    }

    /// The value of a integer.
    pub fn value(self, level: i32) -> f64 {
        self.offset + self.step * f64::from(level)
    }
}
