//! Dynamic regions: given masks, or pixels that vary in the photos of a fixed camera.

use image::{GrayImage, Luma, RgbImage};
use serde::{Deserialize, Serialize};

/// Temporal standard deviation, for values in `[0, 1]`, above which a pixel is dynamic.
pub const LEAST_DEVIATION: f64 = 0.02;

/// Dilation of dynamic pixels, in pixels.
pub const DILATION: usize = 3;

/// The source of a dynamic region.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RegionSource {
    /// The masks of a built-in scene, which are exact.
    TrueMasks,
    /// Masks of the scene or from a separate folder.
    GivenMasks,
    /// The photos: pixels whose standard deviation over the camera's sequence exceeds 0.02 in any channel, dilated by 3
    /// pixels.
    TemporalDeviation,
}

impl RegionSource {
    /// The words in brackets after every metric of a region. The source affects a metric more than most methods do.
    pub const fn words(self) -> &'static str {
        match self {
            Self::TrueMasks => "true masks",
            Self::GivenMasks => "given masks",
            Self::TemporalDeviation => "temporal deviation",
        }
    }
}

/// Sums over the photos of a fixed camera, which determine the deviation of each pixel exactly.
#[derive(Clone, Debug, Default)]
pub struct TemporalDeviation {
    frames: u64,
    width: u32,
    height: u32,
    /// For each channel of each pixel, the sum and the sum of squares of 8-bit values.
    sums: Vec<[u64; 2]>,
}

impl TemporalDeviation {
    /// Adds a frame. Frames with a different size from the first are skipped.
    pub fn add(&mut self, frame: &RgbImage) {
        if self.frames == 0 {
            (self.width, self.height) = frame.dimensions();
            self.sums = vec![[0; 2]; frame.as_raw().len()];
        }
        if frame.dimensions() != (self.width, self.height) {
            return;
        }
        self.frames += 1;
        for ([sum, squares], &value) in self.sums.iter_mut().zip(frame.as_raw()) {
            *sum += u64::from(value);
            *squares += u64::from(value) * u64::from(value);
        }
    }

    /// White where the population standard deviation exceeds 0.02 in any channel, dilated by 3 pixels; `None` for fewer
    /// than two frames.
    pub fn region(&self) -> Option<GrayImage> {
        if self.frames < 2 {
            return None;
        }
        // N sum(v^2) - sum(v)^2 = N^2 var, in integers.
        let least = (LEAST_DEVIATION * 255.0 * self.frames as f64).powi(2);
        let varies = |[sum, squares]: &[u64; 2]| (self.frames * squares - sum * sum) as f64 > least;
        let white = |pixel: &[[u64; 2]]| if pixel.iter().any(varies) { u8::MAX } else { 0 };
        let mask = self.sums.chunks(3).map(white).collect();
        // Proof: `sums` has three entries for each pixel of the first frame, and this is its size.
        let mask = GrayImage::from_raw(self.width, self.height, mask).expect("a mask of the frames' size");
        Some(dilate(&mask, DILATION))
    }
}

/// A mask dilated by `reach` pixels: white where the square of side `2 reach + 1` around a pixel contains white (128 or
/// more).
pub fn dilate(mask: &GrayImage, reach: usize) -> GrayImage {
    let (width, height) = (mask.width() as usize, mask.height() as usize);
    let is_white = |x: usize, y: usize| mask.get_pixel(x as u32, y as u32).0[0] >= 128;
    let around = |centre: usize, length: usize| centre.saturating_sub(reach)..(centre + reach + 1).min(length);
    // Along rows, then along columns.
    let rows: Vec<bool> =
        (0..width * height).map(|i| around(i % width, width).any(|x| is_white(x, i / width))).collect();
    GrayImage::from_fn(width as u32, height as u32, |x, y| {
        let met = around(y as usize, height).any(|y| rows[y * width + x as usize]);
        Luma([if met { u8::MAX } else { 0 }])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(level: u8) -> RgbImage {
        RgbImage::from_pixel(12, 9, image::Rgb([level; 3]))
    }

    fn is_white(mask: &GrayImage, x: u32, y: u32) -> bool {
        mask.get_pixel(x, y).0[0] == 255
    }

    #[test]
    fn one_frame_has_no_region() {
        let mut deviation = TemporalDeviation::default();
        assert_eq!(deviation.region(), None);
        deviation.add(&grey(9));
        assert_eq!(deviation.region(), None);
    }

    #[test]
    fn a_pixel_is_dynamic_above_the_threshold_alone_and_grows_by_three() {
        // Two values d apart deviate by d/2; the threshold is 5.1 levels.
        for (difference, is_dynamic) in [(10, false), (11, true)] {
            let mut deviation = TemporalDeviation::default();
            let mut moved = grey(100);
            moved.put_pixel(4, 4, image::Rgb([100, 100 + difference, 100]));
            deviation.add(&grey(100));
            deviation.add(&moved);
            let region = deviation.region().expect("two frames");
            for (x, y, reached) in [(4, 4, true), (7, 7, true), (1, 1, true), (8, 4, false), (4, 8, false)] {
                assert_eq!(is_white(&region, x, y), is_dynamic && reached, "{difference} levels at {x}, {y}");
            }
        }
    }

    #[test]
    fn growth_stops_at_the_border() {
        let mut mask = GrayImage::new(5, 4);
        mask.put_pixel(0, 3, Luma([128]));
        let grown = dilate(&mask, 1);
        let white = grown.pixels().filter(|pixel| pixel.0[0] == 255).count();
        assert_eq!(white, 4);
        assert!(is_white(&grown, 1, 2));
    }
}
