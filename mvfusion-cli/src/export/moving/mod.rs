//! The container `.4dgs` for moving Gaussians, through the crate `fourdgs`: samples of the scene in time, of which
//! every sixteenth is stored in full and the others as differences.
//!
//! Centres move on straight lines during a sample, through their places in its middle. Sizes, rotations, opacities and
//! colours stay the same for the time of a sample. Colours do not depend on the direction. All numbers are rounded to
//! grids whose spacing is twice the error that a [`Precision`] allows.

mod clock;
mod read;
mod sample;

pub use clock::Clock;
pub use read::{MaxErrors, MovingFile};
pub use sample::Samples;

use clap::ValueEnum;
use fourdgs::quantization::Profile;

/// Samples from one that is stored in full to the next. A reader composes at most this many for any time.
const KEYFRAME_EVERY: usize = 16;

/// How much the numbers in a `.4dgs` file may be off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Precision {
    /// 0.02 of the median size of a Gaussian, 0.5 % in sizes, half an 8-bit level in colours and opacities
    #[default]
    Fine,
    /// 0.05 of the median size, 2 %, one 8-bit level
    Medium,
    /// 0.2 of the median size, 6 %, three 8-bit levels
    Coarse,
}

impl Precision {
    /// What the crate calls it.
    fn profile(self) -> Profile {
        match self {
            Self::Fine => Profile::Fine,
            Self::Medium => Profile::Default,
            Self::Coarse => Profile::Coarse,
        }
    }
}
