//! MVG: the motion-variance feature (paper, "MVG Injection"; METHOD A11, A12).

use burn::module::Module;
use burn::tensor::{Tensor, TensorData};
use mvfusion_render::device::is_gpu;

use super::statistics::{SIGNATURE_WIDTH, VELOCITY_WIDTH};
use crate::config::{Descriptor, MotionConfig};
use crate::model::network::{Mlp, ModuleInit, residual_mlp};
use crate::tensors;

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
        Self { mlp: residual_mlp(&[inputs, config.hidden, width], config.activation, init), octaves: config.octaves }
    }

    /// An encoder with given layers.
    pub fn from_layers(mlp: Mlp, octaves: usize) -> Self {
        Self { mlp, octaves }
    }

    /// Maps `[N, 13]` signatures and `[N, 1 or 4]` values of the moment to `[N, width]`.
    pub fn forward(&self, signatures: Tensor<2>, moment: Tensor<2>) -> Tensor<2> {
        self.mlp.forward(self.join(self.encode(signatures), moment))
    }

    /// The encoding of signatures. It is the same at all times.
    pub(super) fn encode(&self, signatures: Tensor<2>) -> Tensor<2> {
        sinusoidal(signatures, self.octaves)
    }

    /// Joins encoded signatures, `[N, 13 (1 + 2 octaves)]`, with the encoding of `[N, 1 or 4]` values of the moment.
    pub(super) fn join(&self, signatures: Tensor<2>, moment: Tensor<2>) -> Tensor<2> {
        let ([count, columns], blocks) = (moment.dims(), 1 + 2 * self.octaves);
        let signatures = signatures.reshape([count, blocks, SIGNATURE_WIDTH]);
        let moment = sinusoidal(moment, self.octaves).reshape([count, blocks, columns]);
        // Each block is a function of all values, so those of the moment are the last columns of every block.
        Tensor::cat(vec![signatures, moment], 2).reshape([count, blocks * (SIGNATURE_WIDTH + columns)])
    }
}

/// Sinusoidal encoding `[u, sin u, cos u, sin 2u, cos 2u, sin 4u, ..]` of `[N, k]`: `[N, k (1 + 2 octaves)]`, without
/// pi (A11).
///
/// On a CPU, where sines are expensive, each octave follows from the previous one by the double-angle formulas. The error
/// doubles with each octave; with the usual four it is about 1e-6 in f32. On a GPU, where launches are, all octaves are
/// computed together.
pub fn sinusoidal(values: Tensor<2>, octaves: usize) -> Tensor<2> {
    if octaves > 0 && is_gpu(&values.device().inner()) {
        return with_octaves_at_once(values, octaves);
    }
    let mut blocks = vec![values.clone()];
    let mut pair: Option<(Tensor<2>, Tensor<2>)> = None;
    for _ in 0..octaves {
        let (sine, cosine) = match pair {
            None => (values.clone().sin(), values.clone().cos()),
            Some((sine, cosine)) => (sine.clone() * cosine * 2.0, sine.square() * -2.0 + 1.0),
        };
        blocks.extend([sine.clone(), cosine.clone()]);
        pair = Some((sine, cosine));
    }
    Tensor::cat(blocks, 1)
}

fn with_octaves_at_once(values: Tensor<2>, octaves: usize) -> Tensor<2> {
    let [count, columns] = values.dims();
    let factors = (0..octaves).map(|octave| (1_u64 << octave) as f64).collect();
    let factors: Tensor<3> = tensors::from_data_like(TensorData::new::<f64, _>(factors, [1, octaves, 1]), &values);
    let angles = values.clone().unsqueeze_dim::<3>(1) * factors;
    let waves = Tensor::cat(vec![angles.clone().sin(), angles.cos()], 2).reshape([count, 2 * octaves * columns]);
    Tensor::cat(vec![values, waves], 1)
}

#[cfg(test)]
mod tests {
    use burn::tensor::DType;

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
                let encoder = MotionEncoder::from_layers(Mlp::rectified(Vec::new()), octaves);
                let wanted = sinusoidal(Tensor::cat(vec![signatures.clone(), moment.clone()], 1), octaves);
                assert_eq!(values(encoder.forward(signatures, moment)), values(wanted));
            }
        });
    }
}
