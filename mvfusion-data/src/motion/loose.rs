//! Motion in the frames of one still camera whose pose is not known yet.

use image::RgbImage;

use super::film::motion;
use super::moving_pixels::MotionMap;
use super::options::MovingPixelsOptions;
use super::reduce::{Reduced, averaged};
use super::rig::LEAST_FRAMES;

/// Smallest difference between neighbouring blocks that makes an edge, in 8-bit levels.
const EDGE: u8 = 30;

/// Difference from the first frame that changes a block, in 8-bit levels. Noise and compression stay below it.
const CHANGE: u8 = 15;

/// The first frames of a camera, reduced by an integer factor.
#[derive(Debug)]
pub(crate) struct LooseFrames {
    size: (usize, usize),
    factor: usize,
    frames: Vec<Reduced>,
}

impl LooseFrames {
    /// Frames of `size` pixels, each side reduced by `factor`.
    pub(crate) fn new((width, height): (u32, u32), factor: usize) -> Self {
        Self { size: (width as usize, height as usize), factor: factor.max(1), frames: Vec::new() }
    }

    /// Adds a frame.
    pub(crate) fn push(&mut self, frame: &RgbImage) {
        self.frames.push(Reduced { colours: averaged(frame, None, self.factor).0, valid: None });
    }

    /// The motion in each frame; `None` if there are too few frames for a median.
    pub(crate) fn maps(&self) -> Option<Vec<MotionMap>> {
        if self.frames.len() < LEAST_FRAMES {
            return None;
        }
        let motion = motion(&self.frames, &MovingPixelsOptions::default());
        motion.into_iter().map(|blocks| MotionMap::new(self.size, self.factor, blocks)).collect()
    }

    /// The share of the first frame's edges that change in a frame, in the median over the other frames. Edges of still
    /// cameras change only where something passes. `None` without edges or other frames.
    pub(crate) fn changing_edges(&self) -> Option<f64> {
        let (first, others) = self.frames.split_first()?;
        let edges = edges(first, self.size.0.div_ceil(self.factor));
        let changed = |frame: &Reduced| {
            let changed = edges.iter().filter(|&&block| difference(first, frame, block, block) > CHANGE);
            changed.count() as f64 / edges.len() as f64
        };
        let mut shares: Vec<f64> = others.iter().map(changed).collect();
        shares.sort_by(f64::total_cmp);
        (!edges.is_empty()).then(|| shares.get(shares.len() / 2).copied()).flatten()
    }
}

/// The blocks that differ from the next one to the right or below.
fn edges(frame: &Reduced, columns: usize) -> Vec<usize> {
    let blocks = frame.colours.len() / 3;
    let is_edge = |&block: &usize| {
        let right = (block + 1) % columns != 0 && difference(frame, frame, block, block + 1) > EDGE;
        right || (block + columns < blocks && difference(frame, frame, block, block + columns) > EDGE)
    };
    (0..blocks).filter(is_edge).collect()
}

/// The largest difference of a channel between a block of one frame and a block of another.
fn difference(one: &Reduced, other: &Reduced, block: usize, next: usize) -> u8 {
    (0..3).map(|c| one.colours[3 * block + c].abs_diff(other.colours[3 * next + c])).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    const SIZE: (u32, u32) = (96, 64);

    /// Checks of 8 pixels, moved to the right, with a white block in front of them.
    fn frame(shift: u32, mover: u32) -> RgbImage {
        RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| match x.abs_diff(mover) < 6 && y.abs_diff(30) < 6 {
            true => Rgb([255; 3]),
            false => Rgb([if ((x + shift) / 8 + y / 8).is_multiple_of(2) { 40 } else { 160 }; 3]),
        })
    }

    fn loose(frames: impl Iterator<Item = RgbImage>) -> LooseFrames {
        let mut loose = LooseFrames::new(SIZE, 2);
        frames.for_each(|frame| loose.push(&frame));
        loose
    }

    #[test]
    fn edges_of_a_still_camera_stay_and_those_of_a_moving_one_change() {
        let still = loose((0..9).map(|i| frame(0, 10 * i + 5))).changing_edges().expect("edges");
        let moving = loose((0..9).map(|i| frame(2 * i, 50))).changing_edges().expect("edges");
        // The checks come back to where they were now and then.
        assert!(still < 0.1 && moving > 0.5, "{still} {moving}");
        assert_eq!(loose((0..4).map(|_| RgbImage::new(SIZE.0, SIZE.1))).changing_edges(), None);
    }

    #[test]
    fn what_moves_is_marked_and_two_frames_are_too_few() {
        let maps = loose((0..9).map(|i| frame(0, 10 * i + 5))).maps().expect("enough frames");
        let mask = maps[4].mask();
        assert_eq!((mask.get_pixel(45, 30).0[0], mask.get_pixel(80, 50).0[0]), (255, 0));
        assert!(loose((0..2).map(|i| frame(0, i))).maps().is_none());
    }
}
