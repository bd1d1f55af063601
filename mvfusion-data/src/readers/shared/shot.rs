//! A shot: what a reader knows of a picture.

use std::path::PathBuf;

use glam::{DMat3, DVec2, DVec3};

use crate::scene::{Bend, Lens, PictureSource};

/// A picture with its camera and its time.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    /// Name of the view.
    pub(crate) name: String,
    /// The picture.
    pub(crate) source: PictureSource,
    /// A file that marks which of its pixels count.
    pub(crate) mask: Option<PathBuf>,
    pub(crate) lens: FrameLens,
    /// From the world to the camera, OpenCV axes.
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    /// In `[0, 1]`.
    pub(crate) time: f64,
}

/// The description of a picture's lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FrameLens {
    /// A lens for pictures of this width and height.
    Known { lens: Lens, size: DVec2 },
    /// The focal length in widths of the picture, for any size. Pixels are square, and the principal point is centred.
    Angle { focal_in_widths: f64 },
}

impl FrameLens {
    /// The lens for a picture of this size.
    pub(super) fn at_size(&self, size: DVec2) -> Lens {
        match *self {
            Self::Known { lens, size: own } => lens.scaled(size / own),
            Self::Angle { focal_in_widths } => {
                Lens { focal: DVec2::splat(focal_in_widths * size.x), principal: 0.5 * size, bend: Bend::NONE }
            }
        }
    }
}
