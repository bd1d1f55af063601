//! Compile-time parameters of [`blend_backward`](super::blend_backward): the share of a tile, the layout of sums and
//! records.

use super::stage::{FOUR, FOUR_BYTES, TileShare, WORD};
use crate::splat::{COLOUR_CHANNELS, TILE, depth_channel, gradient_record};

/// The middle of a tile's pixels along an axis.
pub(super) const MIDDLE: f64 = (TILE as f64 - 1.0) / 2.0;

/// Compile-time parameters of the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct BlendBackwardKind {
    /// How a tile is divided among the units.
    pub share: TileShare,
    /// The channels of the main image that enter the statistic; `None` without a statistic.
    pub statistic: Option<CountedChannels>,
}

/// The channels that enter the statistic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CountedChannels {
    /// Colour, alpha and depth.
    ColourAndDepth,
    /// Colour, alpha, depth and the features.
    All,
}

/// Vectors in a gradient record of this many channels.
pub const fn record_vectors(channels: usize) -> usize {
    gradient_record::len(channels).div_ceil(FOUR)
}

/// Values in these vectors: the record, and the zeros that fill the last vector.
pub const fn record_numbers(channels: usize) -> usize {
    FOUR * record_vectors(channels)
}

/// Size of these vectors in bytes.
pub const fn record_bytes(channels: usize) -> usize {
    FOUR_BYTES * record_vectors(channels)
}

/// Index of sigma's part times 1 in a unit's sums of a Gaussian (see `composite_backward` in
/// [`blend_backward`](super::blend_backward)).
pub(super) const SUM_ONE: usize = 0;
/// Index of sigma's part times x.
pub(super) const SUM_X: usize = 1;
/// Index of sigma's part times x².
pub(super) const SUM_XX: usize = 2;
/// Index of the first channel. The statistic's parts follow the last channel, see [`BlendBackwardKind::counted_one`].
pub(super) const SUM_CHANNELS: usize = 3;

/// Number of weights of the sums over rows: 1, y, y².
pub(super) const POWERS: usize = 3;

impl BlendBackwardKind {
    /// The kernel for a device with `memory` bytes of shared memory per cube; `None` if no batch fits.
    pub fn fitting(span: usize, channels: usize, statistic: Option<CountedChannels>, memory: usize) -> Option<Self> {
        [WORD, 16, 8, 4, 2, 1]
            .into_iter()
            .map(|batch| Self { share: TileShare { span, channels, batch }, statistic })
            .find(|kind| kind.bytes() <= memory)
    }

    /// Index of the statistic's part times 1 in a unit's sums, if there is a statistic.
    pub(super) const fn counted_one(&self) -> usize {
        SUM_CHANNELS + self.share.channels
    }

    /// Index of the statistic's part times x.
    pub(super) const fn counted_x(&self) -> usize {
        self.counted_one() + 1
    }

    /// Vectors in a unit's sums over its pixels, see `composite_backward`.
    pub(super) const fn sums(&self) -> usize {
        let numbers = if self.statistic.is_some() { self.counted_x() + 1 } else { self.counted_one() };
        numbers.div_ceil(FOUR)
    }

    /// Vectors of the units' sums of a batch.
    pub(super) const fn parts(&self) -> usize {
        self.share.batch * self.share.units() * self.sums()
    }

    /// Vectors of the sums down each column of units, times 1, y and y².
    pub(super) const fn totals(&self) -> usize {
        self.share.batch * self.share.spans() * self.sums() * POWERS
    }

    /// Bytes of shared memory per cube.
    const fn bytes(&self) -> usize {
        self.share.bytes() + FOUR_BYTES * (self.parts() + self.totals()) + size_of::<u32>() * self.share.units()
    }

    /// Whether a channel enters the statistic.
    pub(super) fn counts(&self, channel: usize) -> bool {
        let is_feature = channel >= COLOUR_CHANNELS && channel < depth_channel(self.share.channels);
        match self.statistic {
            None => false,
            Some(CountedChannels::All) => true,
            Some(CountedChannels::ColourAndDepth) => !is_feature,
        }
    }
}
