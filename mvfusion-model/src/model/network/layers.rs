//! Linear layers and MLPs, initialised from our own random streams.

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::{DType, Device, Tensor, TensorData};
use mvfusion_render::mlp::{self, MlpLayout};

use crate::random::Stream;

/// The inputs of a layer's initialisation: a device, a dtype and a source of weights.
#[derive(Debug)]
pub struct ModuleInit<'a> {
    /// Device of the parameters.
    pub device: &'a Device,
    /// Dtype of the parameters.
    pub dtype: DType,
    /// Source of the initial weights.
    pub stream: &'a mut Stream,
}

impl ModuleInit<'_> {
    /// The same with another source of weights.
    pub fn drawing_from<'s>(&'s self, stream: &'s mut Stream) -> ModuleInit<'s> {
        ModuleInit { device: self.device, dtype: self.dtype, stream }
    }

    /// A parameter with the given values.
    pub fn parameter<const D: usize>(&self, values: Vec<f64>, shape: [usize; D]) -> Param<Tensor<D>> {
        let data = TensorData::new(values, shape).convert_dtype(self.dtype);
        Param::from_tensor(Tensor::from_data(data, (self.device, self.dtype)))
    }

    /// A linear layer with Xavier-uniform weights of gain 1 and biases `U(-1/sqrt(inputs), 1/sqrt(inputs))` (METHOD
    /// §2.5).
    pub fn linear(&mut self, inputs: usize, outputs: usize) -> Linear {
        let weight_bound = (6.0 / (inputs + outputs) as f64).sqrt();
        let bias_bound = 1.0 / (inputs as f64).sqrt();
        let weight = (0..inputs * outputs).map(|_| self.stream.uniform(-weight_bound, weight_bound)).collect();
        let bias = (0..outputs).map(|_| self.stream.uniform(-bias_bound, bias_bound)).collect();
        Linear { weight: self.parameter(weight, [inputs, outputs]), bias: Some(self.parameter(bias, [outputs])) }
    }

    /// An MLP with the given widths.
    pub fn mlp(&mut self, widths: &[usize]) -> Mlp {
        Mlp { layers: widths.windows(2).map(|pair| self.linear(pair[0], pair[1])).collect() }
    }
}

/// Linear layers with ReLUs between them.
#[derive(Module, Debug)]
pub struct Mlp {
    /// The layers, first to last.
    pub layers: Vec<Linear>,
}

impl Mlp {
    /// `[N, inputs]` to `[N, outputs]`.
    pub fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        side_by_side(&[&self.layers], input, Rectified::No)
    }
}

/// Whether a ReLU precedes the first layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rectified {
    Yes,
    No,
}

/// Applies chains of layers, with ReLUs between them, to the same rows `[N, inputs]`: `[N, sum of outputs]`. Empty
/// chains have no output. If all chains are empty, the rows are returned unchanged.
pub(crate) fn side_by_side(chains: &[&[Linear]], input: Tensor<2>, rectified: Rectified) -> Tensor<2> {
    let chains: Vec<&[Linear]> = chains.iter().copied().filter(|chain| !chain.is_empty()).collect();
    if chains.is_empty() {
        return input;
    }
    let layout = MlpLayout {
        inputs: input.dims()[1],
        rectified: rectified == Rectified::Yes,
        chains: chains.iter().map(|chain| chain.iter().map(|layer| layer.weight.dims()[1]).collect()).collect(),
    };
    let layers = chains.iter().copied().flatten().map(|layer| mlp::Layer {
        weight: layer.weight.val(),
        // Proof: `ModuleInit::linear` creates every layer with a bias, and checkpoints only replace its values.
        bias: layer.bias.as_ref().expect("every layer of ours has a bias").val(),
    });
    // Proof: the layout is derived from the weights. Weights and `input` have the configured widths and one dtype, also
    // those from a file: `Checkpoint` compares the shape and type of every tensor with the model's. The heads have 19
    // layers, and `model.depth` is at most the number that the op takes. The remaining error is a buffer that is too
    // large for the device. It ends the run with the op's advice, as in `Gpu::room`.
    mlp::forward(input, layers.collect(), &layout).unwrap_or_else(|error| panic!("MLP: {error}"))
}

/// Sets weight and bias of the last layer to zero, so that the module starts without effect.
pub fn zero_last_layer(mut mlp: Mlp) -> Mlp {
    if let Some(last) = mlp.layers.pop() {
        mlp.layers.push(Linear {
            weight: last.weight.map(|w| w.zeros_like().require_grad()),
            bias: last.bias.map(|bias| bias.map(|b| b.zeros_like().require_grad())),
        });
    }
    mlp
}
