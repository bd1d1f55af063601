//! A shot: a reader's data of an image.

use std::path::PathBuf;

use glam::{DMat3, DVec2, DVec3};

use crate::scene::{Distortion, Lens, PictureSource};

/// An image with its camera and its time.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    /// Name of the view.
    pub(crate) name: String,
    /// The image.
    pub(crate) source: PictureSource,
    /// A file that marks its valid pixels.
    pub(crate) mask: Option<PathBuf>,
    pub(crate) lens: FrameLens,
    /// From the world to the camera, OpenCV axes.
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    /// In `[0, 1]`.
    pub(crate) time: f64,
}

/// The description of an image's lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FrameLens {
    /// A lens for images of this width and height.
    Known { lens: Lens, size: DVec2 },
    /// The focal lengths in widths and heights of the image, for any size. The principal point is centred. Without the
    /// second, pixels are square.
    Angle { focal_in_widths: f64, focal_in_heights: Option<f64> },
}

impl FrameLens {
    /// The lens for an image of this size.
    pub(super) fn at_size(&self, size: DVec2) -> Lens {
        match *self {
            Self::Known { lens, size: own } => lens.scaled(size / own),
            Self::Angle { focal_in_widths, focal_in_heights } => {
                let horizontal = focal_in_widths * size.x;
                let vertical = focal_in_heights.map_or(horizontal, |focal| focal * size.y);
                Lens { focal: DVec2::new(horizontal, vertical), principal: 0.5 * size, distortion: Distortion::NONE }
            }
        }
    }
}
