//! Depth and motion layers as 8-bit images.

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

/// Values in `[0, 1]`, row by row, as a heat map: black, red, yellow, white.
pub(super) fn heat_picture(values: &[f32], width: usize) -> RgbImage {
    picture(values, width, |value| {
        let level = |offset: f32| ((3.0 * value - offset).clamp(0.0, 1.0) * 255.0).round() as u8;
        Rgb([level(0.0), level(1.0), level(2.0)])
    })
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
    fn heat_goes_from_black_by_red_and_yellow_to_white() {
        let found = heat_picture(&[0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0], 4);
        let colours: Vec<_> = found.pixels().map(|pixel| pixel.0).collect();
        assert_eq!(colours, [[0, 0, 0], [255, 0, 0], [255, 255, 0], [255, 255, 255]]);
    }
}
