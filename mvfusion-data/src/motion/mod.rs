//! Motion in the images of fixed cameras, and its position in the world.
//!
//! [`MovingPixels`] marks the pixels of each training view that show motion: those that differ from the camera's median
//! over time. [`motion_hull`] finds the places where, at one moment, nearly all cameras that see them see motion in one
//! colour. Gaussians that start there need not travel across the room.
//!
//! [`MovingPixels::of`] computes only the pixels. [`MotionFilm::of`] also keeps the images, whose colours the hull
//! needs. [`MotionFilm::into_moving`] drops them again.
//!
//! Departure: the paper starts its dynamic branch from the static cloud. The hull is a visual hull over motion instead
//! of silhouettes. It adds the photo-consistency test of space carving (Kutulakos and Seitz 2000).

mod choice;
mod clusters;
mod eye;
mod film;
mod finder;
mod hull;
mod loose;
mod moving_pixels;
mod options;
mod places;
mod reach;
mod reduce;
mod rig;
#[cfg(test)]
mod tests;

pub use choice::loneliness;
pub use film::MotionFilm;
pub use finder::MotionFinder;
pub use hull::{MotionSeeds, MotionSummary, motion_hull};
pub(crate) use loose::LooseFrames;
pub use moving_pixels::{MotionMap, MovingPixels, PixelMotion};
pub use options::{MotionHullOptions, MovingPixelsOptions};
