//! MVG: the motion-variance feature (paper, "MVG Injection"; METHOD A11, A12).

use burn::module::Module;
use burn::tensor::Tensor;

use super::statistics::SIGNATURE_WIDTH;
use crate::model::network::{Mlp, ModuleInit, zero_last_layer};

/// Encodes signature and local intensity into a residual of the deformation feature:
/// `h_MVG = W2 relu(W1 PE(V (+) e(t)))`, with `W2` zero at the start.
#[derive(Module, Debug)]
pub struct MotionEncoder {
    /// Two layers; the last one starts at zero.
    pub mlp: Mlp,
    #[module(skip)]
    octaves: usize,
}

impl MotionEncoder {
    /// An encoder to features of `width`, through `hidden` units.
    pub fn new(width: usize, hidden: usize, octaves: usize, init: &mut ModuleInit<'_>) -> Self {
        let inputs = (SIGNATURE_WIDTH + 1) * (1 + 2 * octaves);
        Self { mlp: zero_last_layer(init.mlp(&[inputs, hidden, width])), octaves }
    }

    /// An encoder with given layers.
    pub fn from_layers(mlp: Mlp, octaves: usize) -> Self {
        Self { mlp, octaves }
    }

    /// Maps `[N, 13]` signatures and `[N, 1]` local intensities to `[N, width]`.
    pub fn forward(&self, signatures: Tensor<2>, local: Tensor<2>) -> Tensor<2> {
        self.forward_encoded(self.encode(signatures), local)
    }

    /// The encoding of signatures. It is the same at all times.
    pub(super) fn encode(&self, signatures: Tensor<2>) -> Tensor<2> {
        sinusoidal(signatures, self.octaves)
    }

    /// Maps encoded signatures, `[N, 13 (1 + 2 octaves)]`, and `[N, 1]` local intensities to `[N, width]`.
    pub(super) fn forward_encoded(&self, signatures: Tensor<2>, local: Tensor<2>) -> Tensor<2> {
        let (count, blocks) = (local.dims()[0], 1 + 2 * self.octaves);
        let signatures = signatures.reshape([count, blocks, SIGNATURE_WIDTH]);
        let local = sinusoidal(local, self.octaves).reshape([count, blocks, 1]);
        // Each block is a function of all values, so the local intensity is the last column of every block.
        let rows = Tensor::cat(vec![signatures, local], 2).reshape([count, blocks * (SIGNATURE_WIDTH + 1)]);
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
    fn signature_and_intensity_are_encoded_as_one_row() {
        const ROWS: usize = 7;
        for_each_device(|device| {
            let mut stream = Stream::new(3, 0);
            let mut matrix = |columns: usize| {
                let numbers = (0..ROWS * columns).map(|_| stream.uniform(-3.0, 3.0)).collect();
                Tensor::<2>::from_data(TensorData::new(numbers, [ROWS, columns]), (&device, DType::F32))
            };
            let (signatures, local) = (matrix(SIGNATURE_WIDTH), matrix(1));
            for octaves in [0, 1, 4] {
                let encoder = MotionEncoder::from_layers(Mlp { layers: Vec::new() }, octaves);
                let wanted = sinusoidal(Tensor::cat(vec![signatures.clone(), local.clone()], 1), octaves);
                assert_eq!(values(encoder.forward(signatures.clone(), local.clone())), values(wanted));
            }
        });
    }
}
