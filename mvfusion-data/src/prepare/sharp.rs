//! The sharpest frame of each window of a video.

use image::imageops;
use image::{GrayImage, RgbImage};

/// Longest side at which sharpness is measured, in pixels. Noise of single pixels says nothing about sharpness.
const LONGEST_SIDE: u32 = 960;

/// The variance of the Laplacian, a measure of sharpness (Pech-Pacheco et al. 2000). It compares frames of one video.
pub(super) fn sharpness(frame: &RgbImage) -> f64 {
    let (width, height) = frame.dimensions();
    let factor = width.max(height).div_ceil(LONGEST_SIDE).max(1);
    let grey: GrayImage = match factor {
        1 => imageops::grayscale(frame),
        _ => imageops::grayscale(&imageops::thumbnail(frame, (width / factor).max(1), (height / factor).max(1))),
    };
    let (width, height) = (grey.width() as usize, grey.height() as usize);
    let level = |x: usize, y: usize| f64::from(grey.as_raw()[y * width + x]);
    let (mut sum, mut squares, mut count) = (0.0, 0.0, 0.0f64);
    for y in 1..height.saturating_sub(1) {
        for x in 1..width.saturating_sub(1) {
            let around = level(x - 1, y) + level(x + 1, y) + level(x, y - 1) + level(x, y + 1);
            let laplacian = around - 4.0 * level(x, y);
            sum += laplacian;
            squares += laplacian * laplacian;
            count += 1.0;
        }
    }
    let count = count.max(1.0);
    squares / count - (sum / count).powi(2)
}

/// The windows of a video, of which each gives one frame: `taken` frames per second out of `filmed`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Windows {
    frames_each: f64,
}

impl Windows {
    /// Windows are never shorter than a frame.
    pub(super) fn new(filmed: f64, taken: f64) -> Self {
        Self { frames_each: (filmed / taken).max(1.0) }
    }

    /// The window of a frame.
    pub(super) fn of(self, frame: usize) -> usize {
        // A frame on the border belongs to the later window, however the quotient was rounded.
        (frame as f64 / self.frames_each + 1e-9) as usize
    }

    /// Frames of a window, on average.
    pub(super) fn length(self) -> f64 {
        self.frames_each
    }
}

/// Keeps the sharpest frame of the current window.
#[derive(Debug, Default)]
pub(super) struct Sharpest {
    best: Option<Candidate>,
}

/// The sharpest frame so far.
#[derive(Debug)]
struct Candidate {
    window: usize,
    index: usize,
    sharpness: f64,
    frame: RgbImage,
}

impl Sharpest {
    /// Adds the next frame. Returns the sharpest frame of the window before, once that window is over.
    pub(super) fn push(&mut self, window: usize, index: usize, frame: RgbImage) -> Option<(usize, RgbImage)> {
        let candidate = Candidate { window, index, sharpness: sharpness(&frame), frame };
        match &mut self.best {
            Some(best) if best.window == window => {
                if candidate.sharpness > best.sharpness {
                    *best = candidate;
                }
                None
            }
            best => best.replace(candidate).map(|done| (done.index, done.frame)),
        }
    }

    /// The sharpest frame of the last window.
    pub(super) fn finish(self) -> Option<(usize, RgbImage)> {
        self.best.map(|best| (best.index, best.frame))
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    fn checks() -> RgbImage {
        RgbImage::from_fn(64, 48, |x, y| Rgb([if (x / 4 + y / 4).is_multiple_of(2) { 30 } else { 200 }; 3]))
    }

    #[test]
    fn a_blurred_frame_is_less_sharp_and_an_even_one_not_at_all() {
        let sharp = checks();
        let blurred = imageops::blur(&sharp, 1.5);
        assert!(sharpness(&sharp) > 4.0 * sharpness(&blurred));
        assert_eq!(sharpness(&RgbImage::from_pixel(64, 48, Rgb([90; 3]))), 0.0);
        assert_eq!(sharpness(&RgbImage::new(1, 1)), 0.0);
    }

    #[test]
    fn each_window_gives_its_sharpest_frame() {
        let windows = Windows::new(30.0, 10.0);
        let (sharp, blurred) = (checks(), imageops::blur(&checks(), 1.5));
        let (mut sharpest, mut chosen) = (Sharpest::default(), Vec::new());
        for index in 0..8 {
            let frame = if [1, 5, 6].contains(&index) { sharp.clone() } else { blurred.clone() };
            chosen.extend(sharpest.push(windows.of(index), index, frame).map(|(index, _)| index));
        }
        chosen.extend(sharpest.finish().map(|(index, _)| index));
        assert_eq!(chosen, [1, 5, 6]);
    }

    #[test]
    fn windows_follow_the_rates_and_are_no_shorter_than_a_frame() {
        let count = |windows: Windows, frames: usize| (0..frames).map(|f| windows.of(f)).max().map_or(0, |w| w + 1);
        // A window has 14.985 frames: the twentieth begins at frame 285 and the next one would begin at frame 300.
        assert_eq!(count(Windows::new(29.97, 2.0), 300), 20);
        assert_eq!(count(Windows::new(29.97, 2.0), 301), 21);
        assert_eq!(count(Windows::new(30.0, 2.0), 300), 20);
        assert_eq!(count(Windows::new(24.0, 60.0), 24), 24);
    }
}
