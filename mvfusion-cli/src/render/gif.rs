//! Animated GIFs, written frame by frame.

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use anyhow::Context;
use gif::{Encoder, Frame, Repeat};
use image::RgbImage;
use image::imageops::{FilterType, resize};
use tempfile::NamedTempFile;

use crate::atomic::beside;

/// Maximum width of an animation. Wider frames are downscaled, because a frame takes one byte per pixel before
/// compression.
const MOST_WIDE: u32 = 640;
/// Shortest duration of a frame, in hundredths of a second. Browsers extend shorter durations to ten.
const SHORTEST: u64 = 2;
/// Pixels of a frame that determine its palette. With fewer, small objects lose their colours.
const SAMPLED: u64 = 60_000;

/// An animation in progress. The file is renamed to its final path when it is complete.
pub(super) struct GifWriter {
    path: PathBuf,
    encoder: Encoder<BufWriter<NamedTempFile>>,
    size: (u32, u32),
    pace: Pace,
}

impl GifWriter {
    /// An endless animation with frames of `size`.
    pub(super) fn create(path: &Path, size: (u32, u32), fps: f64) -> anyhow::Result<Self> {
        let size = bounded(size);
        let start = || -> anyhow::Result<_> {
            let (width, height) = (u16::try_from(size.0)?, u16::try_from(size.1)?);
            let mut encoder = Encoder::new(BufWriter::new(beside(path)?), width, height, &[])?;
            encoder.set_repeat(Repeat::Infinite)?;
            Ok(encoder)
        };
        let encoder = start().with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { path: path.to_owned(), encoder, size, pace: Pace { fps, index: 0, next: 0 } })
    }

    /// Adds a frame. Frames are dropped if the frame rate is too high for GIF.
    pub(super) fn add(&mut self, picture: &RgbImage) -> anyhow::Result<()> {
        let Some(delay) = self.pace.step() else { return Ok(()) };
        let (width, height) = self.size;
        let speed = (u64::from(width) * u64::from(height)).div_ceil(SAMPLED).clamp(1, 30) as i32;
        let mut frame = match picture.dimensions() == self.size {
            true => Frame::from_rgb_speed(width as u16, height as u16, picture.as_raw(), speed),
            false => {
                let smaller = resize(picture, width, height, FilterType::Triangle);
                Frame::from_rgb_speed(width as u16, height as u16, smaller.as_raw(), speed)
            }
        };
        frame.delay = delay;
        self.encoder.write_frame(&frame).with_context(|| format!("cannot write {}", self.path.display()))
    }

    /// Ends the animation.
    pub(super) fn finish(self) -> anyhow::Result<()> {
        let path = self.path;
        let end = || -> anyhow::Result<()> {
            let file = self.encoder.into_inner()?.into_inner().map_err(|error| error.into_error())?;
            file.persist(&path)?;
            Ok(())
        };
        end().with_context(|| format!("cannot write {}", path.display()))
    }
}

/// The size of an animation for frames of this size.
fn bounded((width, height): (u32, u32)) -> (u32, u32) {
    if width <= MOST_WIDE {
        return (width, height);
    }
    let height = (u64::from(height) * u64::from(MOST_WIDE)).div_ceil(u64::from(width));
    (MOST_WIDE, u32::try_from(height).unwrap_or(u32::MAX))
}

/// The duration of each frame. Durations are whole hundredths of a second, so later frames compensate for rounding.
struct Pace {
    fps: f64,
    /// Index of the current frame.
    index: u64,
    /// Index of the next shown frame.
    next: u64,
}

impl Pace {
    /// The duration of the current frame in hundredths of a second; `None` if it is dropped.
    fn step(&mut self) -> Option<u16> {
        let index = self.index;
        self.index += 1;
        if index < self.next {
            return None;
        }
        let start = |index: u64| (index as f64 * 100.0 / self.fps).round() as u64;
        let delay = |next: u64| start(next) - start(index);
        self.next = (index + 1..).find(|&next| delay(next) >= SHORTEST).unwrap_or(index + 1);
        Some(u16::try_from(delay(self.next)).unwrap_or(u16::MAX))
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use image::Rgb;

    use super::*;

    #[test]
    fn an_animation_has_its_frames_colours_and_times() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.gif");
        let mut writer = GifWriter::create(&path, (20, 10), 30.0).expect("made");
        let colour = |index: u32| Rgb([40 * index as u8, 200, 255 - 40 * index as u8]);
        for index in 0..6 {
            writer.add(&RgbImage::from_pixel(20, 10, colour(index))).expect("added");
        }
        assert!(!path.exists(), "not before it is whole");
        writer.finish().expect("finished");
        assert_eq!(std::fs::read_dir(folder.path()).expect("listed").count(), 1);

        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(File::open(&path).expect("opened")).expect("a gif");
        let mut delays = Vec::new();
        while let Some(frame) = decoder.read_next_frame().expect("a frame") {
            let [r, g, b] = colour(delays.len() as u32).0;
            assert_eq!((frame.width, frame.height, &frame.buffer[..4]), (20, 10, &[r, g, b, 255][..]));
            delays.push(frame.delay);
        }
        assert_eq!(delays, [3, 4, 3, 3, 4, 3]);
        assert_eq!(decoder.repeat(), Repeat::Infinite);
    }

    #[test]
    fn frames_that_would_be_too_short_are_left_out() {
        let mut pace = Pace { fps: 120.0, index: 0, next: 0 };
        let delays: Vec<_> = (0..6).map(|_| pace.step()).collect();
        // They begin after 0, 1, 2, 3, 3 and 4 hundredths of a second, the seventh after 5 and the eighth after 6.
        assert_eq!(delays, [Some(2), None, Some(2), None, None, Some(2)]);
        let mut slow = Pace { fps: 0.1, index: 0, next: 0 };
        assert_eq!([slow.step(), slow.step()], [Some(1000); 2]);
    }

    #[test]
    fn wide_animations_are_made_smaller() {
        assert_eq!(bounded((1280, 720)), (640, 360));
        assert_eq!(bounded((640, 2000)), (640, 2000));
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.gif");
        let mut writer = GifWriter::create(&path, (800, 50), 30.0).expect("made");
        writer.add(&RgbImage::new(800, 50)).expect("added");
        writer.finish().expect("finished");
        let decoder = gif::DecodeOptions::new().read_info(File::open(&path).expect("opened")).expect("a gif");
        assert_eq!((decoder.width(), decoder.height()), (640, 40));
    }
}
