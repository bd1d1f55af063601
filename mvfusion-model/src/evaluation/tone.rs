//! Depth and motion layers as 8-bit images.

use std::sync::LazyLock;

use colorgrad::Gradient;
use image::{Rgb, RgbImage};

/// Fraction of the pixels that a depth range excludes at either end, because outliers would dominate the scale.
const OUTSIDE: f64 = 0.02;

/// The depths that become white and black.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthRange {
    /// Depth of white.
    pub near: f64,
    /// Depth of black.
    pub far: f64,
}

impl DepthRange {
    /// The range of these depths without outliers, in world units; only positive depths count. `None` if nothing
    /// remains.
    pub fn of(depths: &[f32]) -> Option<Self> {
        let mut sorted: Vec<f32> = depths.iter().copied().filter(|&depth| depth > 0.0).collect();
        sorted.sort_by(f32::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let at = |share: f64| f64::from(sorted[(last as f64 * share).round() as usize]);
        Some(Self { near: at(OUTSIDE), far: at(1.0 - OUTSIDE) })
    }

    /// The union of both ranges.
    pub fn and(self, other: Self) -> Self {
        Self { near: self.near.min(other.near), far: self.far.max(other.far) }
    }

    /// The brightness of a depth: linear in its inverse, like a disparity; black where nothing is rendered.
    fn brightness(self, depth: f32) -> f32 {
        if depth <= 0.0 {
            return 0.0;
        }
        let span = (1.0 / self.near - 1.0 / self.far).max(f64::MIN_POSITIVE);
        (((1.0 / f64::from(depth) - 1.0 / self.far) / span).clamp(0.0, 1.0)) as f32
    }
}

/// Depths, row by row, as a grey image.
pub(super) fn depth_picture(depths: &[f32], width: usize, range: DepthRange) -> RgbImage {
    picture(depths, width, |depth| Rgb([(range.brightness(depth) * 255.0).round() as u8; 3]))
}

/// The colours of a heat map, as many as 8 bits distinguish: the map inferno of Matplotlib, from black through purple and
/// orange to pale yellow. Equal steps of a value look equally large, also in grey and to most colour-blind people.
static HEAT: LazyLock<[Rgb<u8>; 256]> = LazyLock::new(|| {
    let inferno = colorgrad::preset::inferno();
    std::array::from_fn(|level| {
        let [r, g, b, _] = inferno.at(level as f32 / 255.0).to_rgba8();
        Rgb([r, g, b])
    })
});

/// Values in `[0, 1]`, row by row, as a heat map.
pub(super) fn heat_picture(values: &[f32], width: usize) -> RgbImage {
    picture(values, width, |value| HEAT[(value.clamp(0.0, 1.0) * 255.0).round() as usize])
}

fn picture(values: &[f32], width: usize, colour: impl Fn(f32) -> Rgb<u8>) -> RgbImage {
    let height = values.len() / width.max(1);
    let pixel = |x: u32, y: u32| colour(values[y as usize * width + x as usize]);
    RgbImage::from_fn(width as u32, height as u32, pixel)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_things_are_white_far_ones_black_and_half_the_disparity_is_grey() {
        let range = DepthRange { near: 1.0, far: 4.0 };
        // Disparities 1, 0.625 and 0.25; then nothing, too near, too far.
        let found = depth_picture(&[1.0, 1.6, 4.0, 0.0, 0.5, 9.0], 3, range);
        assert_eq!(found.dimensions(), (3, 2));
        assert_eq!(found.pixels().map(|pixel| pixel.0[0]).collect::<Vec<_>>(), [255, 128, 0, 0, 255, 0]);
    }

    #[test]
    fn a_range_leaves_out_strays_and_what_is_not_there() {
        let depths: Vec<f32> = (0..=100).map(|i| 1.0 + i as f32).chain([0.0; 50]).collect();
        assert_eq!(DepthRange::of(&depths), Some(DepthRange { near: 3.0, far: 99.0 }));
        assert_eq!(DepthRange::of(&[0.0, 0.0]), None);
        let other = DepthRange { near: 4.0, far: 120.0 };
        assert_eq!(DepthRange { near: 3.0, far: 99.0 }.and(other), DepthRange { near: 3.0, far: 120.0 });
    }

    #[test]
    fn equal_steps_of_heat_look_equally_large() {
        let ramp: Vec<f32> = (0..=16).map(|step| step as f32 / 16.0).collect();
        let lightness: Vec<f64> = heat_picture(&ramp, ramp.len()).pixels().map(|pixel| lightness(pixel.0)).collect();
        let steps: Vec<f64> = lightness.windows(2).map(|pair| pair[1] - pair[0]).collect();
        // From black to nearly white, and no step is much larger or smaller than the mean.
        assert!(lightness[0] < 2.0 && lightness[16] > 95.0, "{lightness:?}");
        let mean = (lightness[16] - lightness[0]) / 16.0;
        assert!(steps.iter().all(|step| (0.5..1.6).contains(&(step / mean))), "{steps:?}");
    }

    #[test]
    fn heat_that_is_no_share_is_cut_off() {
        let found = heat_picture(&[-1.0, 0.0, 1.0, 7.0, f32::NAN], 5);
        let colours: Vec<_> = found.pixels().map(|pixel| pixel.0).collect();
        assert_eq!((colours[0], colours[3], colours[4]), (colours[1], colours[2], colours[1]));
    }

    /// The lightness `L*` of CIELAB of an sRGB colour, 0 to 100.
    fn lightness(colour: [u8; 3]) -> f64 {
        let linear = colour.map(|level| match f64::from(level) / 255.0 {
            level @ ..=0.04045 => level / 12.92,
            level => ((level + 0.055) / 1.055).powf(2.4),
        });
        let luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
        match luminance {
            ..=0.008856 => 903.3 * luminance,
            _ => 116.0 * luminance.cbrt() - 16.0,
        }
    }
}
