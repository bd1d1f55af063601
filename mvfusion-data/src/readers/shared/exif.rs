//! Photos whose metadata (EXIF) ask to be turned.
//!
//! Phones and cameras store the pixels as the sensor lies, and how the photo is to be turned in the metadata. Programs
//! that compute cameras differ: COLMAP reads the pixels as they are stored, others turn them first. The size that a
//! camera is for tells which: an image of the camera's shape is used as it is stored, and turned if only that gives it
//! this shape. If both have it (square images, half turns, cameras without a size), it is used as it is stored.

use super::shot::{FrameLens, Shot};
use super::sizes::is_scaled;
use crate::error::DataError;
use crate::scene::{ExifOrientation, PictureHeader, PictureSource};

/// A shot's image as it is used.
#[derive(Clone, Copy, Debug)]
pub(super) struct Used {
    /// Width and height in pixels.
    pub(super) size: (u32, u32),
    pub(super) exif: ExifOrientation,
}

/// How the image of a shot is used.
///
/// # Errors
/// [`DataError::Image`] if its header cannot be read.
pub(super) fn used(shot: &Shot) -> Result<Used, DataError> {
    let PictureSource::Image(path) = &shot.source else {
        return Ok(Used { size: shot.source.size()?, exif: ExifOrientation::Absent });
    };
    let header = PictureHeader::read(path)?;
    let fits = |(width, height): (u32, u32)| match shot.lens {
        FrameLens::Known { size, .. } => is_scaled((size.x, size.y), (f64::from(width), f64::from(height))),
        FrameLens::Angle { .. } => true,
    };
    let (stored, upright) = (header.size, header.upright_size());
    Ok(match header.is_turned() {
        false => Used { size: stored, exif: ExifOrientation::Absent },
        true if fits(stored) || !fits(upright) => Used { size: stored, exif: ExifOrientation::Ignored },
        true => Used { size: upright, exif: ExifOrientation::Applied },
    })
}
