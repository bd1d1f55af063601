//! Linear layers and MLPs, initialised from our own random streams.

use std::slice::from_ref;

use burn::module::{Module, Param};
use burn::nn::Linear;
use burn::tensor::{DType, Device, Tensor, TensorData};
use mvfusion_render::activation::sigmoid;
use mvfusion_render::mlp::{self, MlpLayout};

use crate::config::Activation;
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

    /// An MLP with the given widths and ReLUs.
    pub fn mlp(&mut self, widths: &[usize]) -> Mlp {
        Mlp::rectified(widths.windows(2).map(|pair| self.linear(pair[0], pair[1])).collect())
    }
}

/// Linear layers with activations between them.
#[derive(Module, Debug)]
pub struct Mlp {
    /// The layers, first to last.
    pub layers: Vec<Linear>,
    /// What is between them.
    #[module(skip)]
    pub activation: Activation,
}

impl Mlp {
    /// Layers with ReLUs between them.
    pub fn rectified(layers: Vec<Linear>) -> Self {
        Self { layers, activation: Activation::Relu }
    }

    /// `[N, inputs]` to `[N, outputs]`.
    pub fn forward(&self, input: Tensor<2>) -> Tensor<2> {
        self.through(&self.layers, input)
    }

    /// The last hidden units before their activation: `[N, hidden]`; the input if there is only one layer.
    pub fn hidden(&self, input: Tensor<2>) -> Tensor<2> {
        self.through(self.layers.split_last().map_or(&[], |(_, before)| before), input)
    }

    fn through(&self, layers: &[Linear], input: Tensor<2>) -> Tensor<2> {
        match self.activation {
            Activation::Relu => side_by_side(&[layers], input, Rectified::No),
            Activation::Silu => layers.iter().enumerate().fold(input, |rows, (index, layer)| {
                let rows = if index > 0 { rows.clone() * sigmoid(rows) } else { rows };
                side_by_side(&[from_ref(layer)], rows, Rectified::No)
            }),
        }
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

/// The MLP of a motion-aware module, which starts without effect.
pub fn residual_mlp(widths: &[usize], activation: Activation, init: &mut ModuleInit<'_>) -> Mlp {
    zero_last_layer(Mlp { activation, ..init.mlp(widths) })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{for_each_device, values};

    #[test]
    fn activations_stand_between_layers_and_hidden_units_before_them() {
        for_each_device(|device| {
            let mut stream = Stream::new(1, 0);
            let learning = device.clone().autodiff();
            let mut init = ModuleInit { device: &learning, dtype: DType::F32, stream: &mut stream };
            let layer = |weight: f64, init: &ModuleInit<'_>| Linear {
                weight: init.parameter(vec![weight], [1, 1]),
                bias: Some(init.parameter(vec![0.0], [1])),
            };
            let layers = vec![layer(2.0, &init), layer(3.0, &init)];
            let input = Tensor::<2>::from_data([[1.0f32], [-1.0]], &device);
            let silu = |x: f64| x / (1.0 + (-x).exp());
            for (activation, wanted) in
                [(Activation::Relu, [6.0, 0.0]), (Activation::Silu, [3.0 * silu(2.0), 3.0 * silu(-2.0)])]
            {
                let mlp = Mlp { layers: layers.clone(), activation }.valid();
                let found = values(mlp.forward(input.clone()));
                assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6), "{activation:?}: {found:?}");
                assert_eq!(values(mlp.hidden(input.clone())), [2.0, -2.0]);
            }
            // The last layer is zero, so a module starts without effect.
            let silent = residual_mlp(&[1, 4, 2], Activation::Silu, &mut init).valid();
            assert_eq!(values(silent.forward(input)), [0.0; 4]);
        });
    }
}
