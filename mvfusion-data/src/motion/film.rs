//! The film of fixed cameras, and its motion: the difference from each camera's median over time.

use rayon::prelude::*;
use tracing::debug;

use super::moving_pixels::{MotionMap, MovingPixels, PixelMotion};
use super::options::MovingPixelsOptions;
use super::reduce::{Reduced, reduced};
use super::rig::{LEAST_FRAMES, StillCamera, StillRig};
use crate::error::DataError;
use crate::scene::Scene;

/// Bytes of a block: three for its colour, one for its motion.
const COLOUR_BYTES: u64 = 3;
const MOTION_BYTES: u64 = 1;
/// Factor from the median absolute deviation to the standard deviation of normal noise.
const DEVIATION_OF_MEDIAN: f64 = 1.4826;
/// Marks a missing median: the block is valid in too few frames.
const NO_MEDIAN: u16 = u16::MAX;
/// Blocks per task in the computation of medians. Their samples of all frames stay in the cache.
const CHUNK: usize = 512;

/// The images of fixed, synchronised cameras, reduced to a memory budget, and the motion in them.
#[derive(Clone, Debug)]
pub struct MotionFilm {
    pub(super) rig: StillRig,
    factor: usize,
    moving: MovingPixels,
    /// Colours of the blocks by training view; empty if they are not kept.
    colours: Vec<Vec<u8>>,
}

/// The parts of a film that are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Keep {
    /// Only the moving pixels.
    Motion,
    /// The images as well.
    Pictures,
}

impl MotionFilm {
    /// Reads the training views of fixed, synchronised cameras, each once, one camera after another. `None` without
    /// three such cameras that have three moments in common. Held-out views are not opened.
    ///
    /// # Errors
    /// [`DataError::Image`] if an image or mask cannot be read.
    pub fn of(scene: &Scene, options: &MovingPixelsOptions) -> Result<Option<Self>, DataError> {
        Self::make(scene, options, Keep::Pictures)
    }

    fn make(scene: &Scene, options: &MovingPixelsOptions, keep: Keep) -> Result<Option<Self>, DataError> {
        let Some(rig) = StillRig::of(scene) else { return Ok(None) };
        let factor = reduction(&rig, options.memory);
        let mut maps = vec![None; scene.train.len()];
        let mut colours = vec![Vec::new(); scene.train.len()];
        for still in &rig.cameras {
            let frames: Vec<Reduced> =
                still.views.par_iter().map(|&view| reduced(&scene.train[view], factor)).collect::<Result<_, _>>()?;
            let motion = motion(&frames, options);
            let size = (still.camera.width, still.camera.height);
            for ((&view, frame), blocks) in still.views.iter().zip(frames).zip(motion) {
                maps[view] = MotionMap::new(size, factor, blocks);
                if keep == Keep::Pictures {
                    colours[view] = frame.colours;
                }
            }
        }
        let moving = MovingPixels::from_maps(maps);
        debug!(cameras = rig.cameras.len(), moments = rig.moments.len(), factor, "moving pixels found");
        Ok(Some(Self { rig, factor, moving, colours }))
    }

    /// Bytes that reading the film of a scene takes: the kept data, and the frames of the camera that is read. `None`
    /// without such cameras. No image is opened.
    pub fn need(scene: &Scene, options: &MovingPixelsOptions) -> Option<u64> {
        let rig = StillRig::of(scene)?;
        let factor = reduction(&rig, options.memory);
        let of_camera = |still: &StillCamera| {
            let camera = &still.camera;
            (camera.width.div_ceil(factor) * camera.height.div_ceil(factor) * still.views.len()) as u64
        };
        let blocks = rig.cameras.iter().map(of_camera);
        let longest = blocks.clone().max().unwrap_or(0);
        // Beside its colours, a block of the camera that is read has a distance from its median.
        Some(blocks.sum::<u64>() * (COLOUR_BYTES + MOTION_BYTES) + longest * (COLOUR_BYTES + 2 * MOTION_BYTES))
    }

    /// The moving pixels.
    pub fn moving(&self) -> &MovingPixels {
        &self.moving
    }

    /// The moving pixels. The images are dropped.
    pub fn into_moving(self) -> MovingPixels {
        self.moving
    }

    /// The factor by which each side of the images was reduced.
    pub fn factor(&self) -> usize {
        self.factor
    }

    /// Bytes of the kept data.
    pub fn bytes(&self) -> u64 {
        let colours = self.colours.iter().map(Vec::len).sum::<usize>() as u64;
        let maps = (0..self.colours.len()).filter_map(|view| self.moving.map(view));
        colours + MOTION_BYTES * maps.map(|map| map.blocks().len() as u64).sum::<u64>()
    }

    /// Motion and block colours of a training view.
    pub(super) fn picture(&self, view: usize) -> Option<(&MotionMap, &[u8])> {
        Some((self.moving.map(view)?, self.colours.get(view)?))
    }
}

impl MovingPixels {
    /// The moving pixels in the views of fixed, synchronised cameras. `None` without three such cameras that have three
    /// moments in common. Held-out views are not opened.
    ///
    /// # Errors
    /// [`DataError::Image`] if an image or mask cannot be read.
    pub fn of(scene: &Scene, options: &MovingPixelsOptions) -> Result<Option<Self>, DataError> {
        Ok(MotionFilm::make(scene, options, Keep::Motion)?.map(MotionFilm::into_moving))
    }
}

/// The smallest integer reduction at which the images fit the budget with their colours. It does not depend on whether
/// colours are kept, so a resumed run finds the same motion again.
fn reduction(rig: &StillRig, memory: u64) -> usize {
    let bytes = |factor: usize| {
        let blocks = rig.cameras.iter().map(|still| {
            let camera = &still.camera;
            (camera.width.div_ceil(factor) * camera.height.div_ceil(factor) * still.views.len()) as u64
        });
        blocks.sum::<u64>() * (COLOUR_BYTES + MOTION_BYTES)
    };
    let longest = rig.cameras.iter().map(|still| still.camera.width.max(still.camera.height)).max().unwrap_or(1);
    (1..longest).find(|&factor| bytes(factor) <= memory).unwrap_or(longest.max(1))
}

/// The motion in the frames of one camera.
pub(super) fn motion(frames: &[Reduced], options: &MovingPixelsOptions) -> Vec<Vec<PixelMotion>> {
    let medians = medians(frames);
    let distances: Vec<Vec<Option<u8>>> = frames.par_iter().map(|frame| distances(frame, &medians)).collect();
    let noise = options.noise_deviations * DEVIATION_OF_MEDIAN * median_distance(&distances);
    let [fast, slow] = [options.fast_levels, options.slow_levels].map(|levels| in_half_levels(levels.max(noise)));
    let restless = restless(&distances, slow);
    let block = |distance: Option<u8>, restless: bool| match distance {
        None => PixelMotion::IGNORED,
        Some(distance) if restless || f64::from(distance) > fast => PixelMotion::moving(distance.div_ceil(2)),
        Some(distance) => PixelMotion::still(distance.div_ceil(2)),
    };
    let picture = |distances: Vec<Option<u8>>| {
        distances.iter().zip(&restless).map(|(&distance, &restless)| block(distance, restless)).collect()
    };
    distances.into_par_iter().map(picture).collect()
}

/// A threshold in half levels. A threshold that no distance can exceed stays one.
fn in_half_levels(levels: f64) -> f64 {
    (2.0 * levels).min(f64::from(u8::MAX))
}

/// Twice the median over time of each channel of each block, over the frames in which the block is valid.
fn medians(frames: &[Reduced]) -> Vec<u16> {
    let channels = frames.first().map_or(0, |frame| frame.colours.len());
    let mut medians = vec![NO_MEDIAN; channels];
    medians.par_chunks_mut(3 * CHUNK).enumerate().for_each(|(chunk, medians)| {
        let mut levels = Vec::with_capacity(frames.len());
        for (offset, median) in medians.iter_mut().enumerate() {
            let channel = chunk * 3 * CHUNK + offset;
            levels.clear();
            levels.extend(frames.iter().filter(|f| f.counts(channel / 3)).map(|frame| frame.colours[channel]));
            if levels.len() >= LEAST_FRAMES {
                *median = twice_the_median(&mut levels);
            }
        }
    });
    medians
}

/// Twice the median, which is an integer. `levels` is not empty.
fn twice_the_median(levels: &mut [u8]) -> u16 {
    let odd = levels.len() % 2 == 1;
    let (below, &mut upper, _) = levels.select_nth_unstable(levels.len() / 2);
    let lower = if odd { upper } else { below.iter().copied().max().unwrap_or(upper) };
    u16::from(lower) + u16::from(upper)
}

impl Reduced {
    fn counts(&self, block: usize) -> bool {
        self.valid.as_ref().is_none_or(|valid| valid[block])
    }
}

/// Distance of each block of a frame from its median, in the channel where it is largest. It is in half levels, at most
/// 255. `None` if the block is invalid.
fn distances(frame: &Reduced, medians: &[u16]) -> Vec<Option<u8>> {
    let away = |level: u8, twice: u16| (2 * u16::from(level)).abs_diff(twice);
    let blocks = frame.colours.chunks_exact(3).zip(medians.chunks_exact(3)).enumerate();
    blocks
        .map(|(block, (levels, medians))| {
            let known = medians[0] != NO_MEDIAN && frame.counts(block);
            known.then(|| {
                let largest = (0..3).map(|channel| away(levels[channel], medians[channel])).max();
                largest.unwrap_or(0).min(u16::from(u8::MAX)) as u8
            })
        })
        .collect()
}

/// The median of all distances, in levels. Most of an image is still, so this measures only noise.
fn median_distance(distances: &[Vec<Option<u8>>]) -> f64 {
    let mut histogram = [0u64; 256];
    for distance in distances.iter().flatten().flatten() {
        histogram[usize::from(*distance)] += 1;
    }
    let half = histogram.iter().sum::<u64>() / 2;
    let mut below = 0;
    let median = histogram.iter().position(|&count| {
        below += count;
        below > half
    });
    median.unwrap_or(0) as f64 / 2.0
}

/// Blocks that are more than `slow` half levels from the median in over half of the frames in which they are valid.
fn restless(distances: &[Vec<Option<u8>>], slow: f64) -> Vec<bool> {
    let blocks = distances.first().map_or(0, Vec::len);
    // Number of frames in which a block is valid, and in which it is away from the median.
    let mut frames = vec![[0u32; 2]; blocks];
    for picture in distances {
        for (frames, distance) in frames.iter_mut().zip(picture) {
            if let Some(distance) = distance {
                frames[0] += 1;
                frames[1] += u32::from(f64::from(*distance) > slow);
            }
        }
    }
    frames.iter().map(|&[seen, away]| 2 * away > seen).collect()
}
