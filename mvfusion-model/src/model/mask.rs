//! The channels of the learned mask, and their order.

use burn::tensor::Tensor;

/// A channel of the learned mask (METHOD §1.2). The order is the same everywhere: logits of the Gaussians, offsets of
/// the heads, splat features, images, and files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskChannel {
    /// Static background.
    Static,
    /// Brightness control of the static branch.
    Brightness,
    /// Dynamic foreground.
    Dynamic,
}

impl MaskChannel {
    /// All channels, in order.
    pub const ALL: [Self; 3] = [Self::Static, Self::Brightness, Self::Dynamic];

    /// Selects this channel in dimension 1: `[N, 3]` to `[N, 1]`, `[B, 3, H, W]` to `[B, 1, H, W]`.
    pub fn of<const D: usize>(self, channels: &Tensor<D>) -> Tensor<D> {
        channels.clone().narrow(1, self as usize, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{for_each_device, values};

    #[test]
    fn channels_are_numbered_as_they_are_listed() {
        assert_eq!(MaskChannel::ALL.map(|channel| channel as usize), [0, 1, 2]);
        for_each_device(|device| {
            let channels = Tensor::<2>::from_floats([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], &device);
            assert_eq!(values(MaskChannel::Brightness.of(&channels)), [2.0, 5.0]);
        });
    }
}
