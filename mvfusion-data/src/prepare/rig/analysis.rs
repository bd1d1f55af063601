//! The beginning of a video: its first frame, whether the camera stands still, and what moves.

use std::path::Path;

use image::{DynamicImage, GrayImage, RgbImage};

use super::camera::Camera;
use crate::motion::LooseFrames;
use crate::prepare::error::PrepareError;
use crate::prepare::event::{Event, Listener, Tell};
use crate::prepare::masks::grown;
use crate::video::{FrameStore, Video};

/// The part of a video that is looked at, in seconds.
const SECONDS: f64 = 10.0;

/// Largest number of frames that are looked at.
const MOST_FRAMES: usize = 30;

/// Width to which frames are reduced, in pixels, about: means of blocks have little noise.
const WIDTH: u32 = 480;

/// Largest share of edges that change in the frames of a still camera.
const STILL: f64 = 0.5;

/// Whether a camera with this share of changing edges stands still.
pub(super) fn is_still(changing_edges: f64) -> bool {
    changing_edges <= STILL
}

/// The beginning of a video.
pub(super) struct Start {
    first: RgbImage,
    /// Pixels by which masks grow: features at the border of a mover see it.
    reach: u32,
    loose: LooseFrames,
    /// The share of the first frame's edges that change.
    pub(super) changing_edges: Option<f64>,
}

impl Start {
    /// Decodes the beginning of a camera's video, from its first frame in the scene on.
    ///
    /// # Errors
    /// If it cannot be decoded.
    pub(super) fn of(camera: &Camera, listen: &mut Listener<'_>) -> Result<Self, PrepareError> {
        let begin = camera.first_frame();
        let within = ((SECONDS * camera.clip.fps).ceil() as usize).clamp(1, camera.clip.frames - begin);
        let stride = within.div_ceil(MOST_FRAMES);
        let (width, height) = camera.video.size();
        let factor = width.div_ceil(WIDTH).max(1);
        let mut loose = LooseFrames::new((width, height), factor as usize);
        let mut first = None;
        let video = Video::open(camera.video.path(), begin + within, &FrameStore::new(None))?;
        video.each_frame(&mut |index, frame| -> Result<(), PrepareError> {
            listen.tell(Event::Continues)?;
            if index >= begin && (index - begin).is_multiple_of(stride) {
                loose.push(&frame);
                if first.is_none() {
                    first = Some(frame);
                }
            }
            Ok(())
        })?;
        let changing_edges = loose.changing_edges();
        let first = first.unwrap_or_else(|| RgbImage::new(width, height));
        Ok(Self { first, reach: 2 * factor, loose, changing_edges })
    }

    /// Where something moves in the first frame, and a little around it; `None` if there are too few frames.
    pub(super) fn moving(&self) -> Option<GrayImage> {
        let first = self.loose.maps()?.into_iter().next()?;
        Some(grown(&first.mask(), self.reach))
    }

    /// Writes the first frame.
    ///
    /// # Errors
    /// [`PrepareError::Unwritable`].
    pub(super) fn save(&self, path: &Path) -> Result<(), PrepareError> {
        use image::codecs::jpeg::JpegEncoder;
        /// JPEG's best: the name of the file is that of 4DGaussians, and so is its format.
        const QUALITY: u8 = 100;
        let mut bytes = Vec::new();
        let encoded = DynamicImage::from(self.first.clone())
            .write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, QUALITY))
            .map_err(|error| error.to_string())
            .and_then(|()| std::fs::write(path, bytes).map_err(|error| error.to_string()));
        encoded.map_err(|reason| PrepareError::unwritable(path, reason))
    }
}

/// The white share of a mask.
pub(super) fn share(mask: &GrayImage) -> f64 {
    let white = mask.pixels().filter(|pixel| pixel.0[0] > 0).count();
    white as f64 / mask.pixels().len().max(1) as f64
}
