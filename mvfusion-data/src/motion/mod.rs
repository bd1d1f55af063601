//! What moves in the pictures of cameras that stand still, and where in the world it is.
//!
//! [`MovingPixels`] tells for each training view which pixels show something that moves: those that differ from what
//! their camera shows otherwise. [`motion_hull`] looks for the places in the world where, at one moment, nearly all
//! cameras that see them see motion, in one colour. Gaussians that start there need not travel across the room to what
//! they shall show.
//!
//! [`MovingPixels::of`] is for who wants the pixels alone. [`MotionFilm::of`] keeps the pictures beside them, which the
//! hull needs for its colours, and [`MotionFilm::into_moving`] lets them go.
//!
//! Departure: the paper starts its dynamic branch from the static cloud. The hull is a visual hull over motion instead
//! of silhouettes, with the test of photo consistency that space carving has (Kutulakos and Seitz 2000).

mod choice;
mod clusters;
mod eye;
mod film;
mod finder;
mod hull;
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
pub use moving_pixels::{MotionMap, MovingPixels, PixelMotion};
pub use options::{MotionHullOptions, MovingPixelsOptions};
