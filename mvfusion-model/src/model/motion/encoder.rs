//! MVG: the motion-variance feature (paper, "MVG Injection"; METHOD A11, A12).

use burn::module::Module;
use burn::tensor::Tensor;

use super::statistics::{SIGNATURE_WIDTH, VELOCITY_WIDTH};
use crate::config::{Descriptor, MotionConfig};
use crate::model::network::{Mlp, ModuleInit, zero_last_layer};

/// Encodes the signature and what is known of the moment into a residual of the deformation feature:
/// `h_MVG = W2 relu(W1 PE(V (+) e(t)))`, with `W2` zero at the start. Of a moment, the local intensity `e(t)` is known,
/// and with `motion.descriptor = "momentary"` also the velocity.
#[derive(Module, Debug)]
pub struct MotionEncoder {
    /// Two layers; the last one starts at zero.
    pub mlp: Mlp,
    #[module(skip)]
    octaves: usize,
}

impl MotionEncoder {
    /// An encoder to features of `width`.
    pub fn new(width: usize, config: &MotionConfig, init: &mut ModuleInit<'_>) -> Self {
        let moment = if config.descriptor == Descriptor::Momentary { 1 + VELOCITY_WIDTH } else { 1 };
        let inputs = (SIGNATURE_WIDTH + moment) * (1 + 2 * config.octaves);
        Self { mlp: zero_last_layer(init.mlp(&[inputs, config.hidden, width])), octaves: config.octaves }
    }

    /// An encoder with given layers.
    pub fn from_layers(mlp: Mlp, octaves: usize) -> Self {
        Self { mlp, octaves }
    }

    /// Maps `[N, 13]` signatures and `[N, 1 or 4]` values of the moment to `[N, width]`.
    pub fn forward(&self, signatures: Tensor<2>, moment: Tensor<2>) -> Tensor<2> {
        self.forward_encoded(self.encode(signatures), moment)
    }

    /// The encoding of signatures. It is the same at all times.
    pub(super) fn encode(&self, signatures: Tensor<2>) -> Tensor<2> {
        sinusoidal(signatures, self.octaves)
    }

    /// Maps encoded signatures, `[N, 13 (1 + 2 octaves)]`, and `[N, 1 or 4]` values of the moment to `[N, width]`.
    pub(super) fn forward_encoded(&self, signatures: Tensor<2>, moment: Tensor<2>) -> Tensor<2> {
        let ([count, columns], blocks) = (moment.dims(), 1 + 2 * self.octaves);
        let signatures = signatures.reshape([count, blocks, SIGNATURE_WIDTH]);
        let moment = sinusoidal(moment, self.octaves).reshape([count, blocks, columns]);
        // Each block is a function of all values, so those of the moment are the last columns of every block.
        let rows = Tensor::cat(vec![signatures, moment], 2).reshape([count, blocks * (SIGNATURE_WIDTH + columns)]);
        self.mlp.forward(rows)
    }
}

/// Sinusoidal encoding `[u, sin u, cos u, sin 2u, cos 2u, sin 4u, ..]` of `[N, k]`: `[N, k (1 + 2 octaves)]`, without
/// pi (A11).
///
/// Each octave follows from the previous one by the double-angle formulas, because sines are expensive on a CPU. The
/// error doubles with each octave; with the usual four it is about 1e-6 in f32.
pub fn sinusoidal(values: Tensor<2>, octaves: usize) -> Tensor<2> {
    let (mut sine, mut cosine) = (values.clone().sin(), values.clone().cos());
    let mut blocks = vec![values];
    for _ in 0..octaves {
        blocks.extend([sine.clone(), cosine.clone()]);
        (sine, cosine) = (sine.clone() * cosine * 2.0, sine.square() * -2.0 + 1.0);
    }
    Tensor::cat(blocks, 1)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, TensorData};

    use super::*;
    use crate::random::Stream;
    use crate::test_support::{for_each_device, values};

    #[test]
    fn signature_and_moment_are_encoded_as_one_row() {
        const ROWS: usize = 7;
        for_each_device(|device| {
            let mut stream = Stream::new(3, 0);
            let mut matrix = |columns: usize| {
                let numbers = (0..ROWS * columns).map(|_| stream.uniform(-3.0, 3.0)).collect();
                Tensor::<2>::from_data(TensorData::new(numbers, [ROWS, columns]), (&device, DType::F32))
            };
            for (octaves, columns) in [(0, 1), (1, 1), (4, 1), (2, 1 + VELOCITY_WIDTH)] {
                let (signatures, moment) = (matrix(SIGNATURE_WIDTH), matrix(columns));
                let encoder = MotionEncoder::from_layers(Mlp { layers: Vec::new() }, octaves);
                let wanted = sinusoidal(Tensor::cat(vec![signatures.clone(), moment.clone()], 1), octaves);
                assert_eq!(values(encoder.forward(signatures, moment)), values(wanted));
            }
        });
    }
}
