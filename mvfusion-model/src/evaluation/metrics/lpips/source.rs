//! Construction of networks from a source of weights.

use burn::module::Param;
use burn::nn::PaddingConfig2d;
use burn::nn::conv::Conv2d;
use burn::nn::pool::MaxPool2dConfig;
use burn::tensor::{DType, Device, Tensor, TensorData};

use super::layout::{Backbone, ConvolutionLayout, StageLayout};
use super::network::{Lpips, Stage};
use crate::ModelError;
use crate::random::Stream;

/// A source of the weights of a network.
pub(super) trait Source {
    /// The tensor with a name and shape, in single precision.
    ///
    /// # Errors
    /// If the tensor does not exist.
    fn numbers(&mut self, name: &str, shape: &[usize]) -> Result<TensorData, ModelError>;

    /// The device of the network.
    fn device(&self) -> &Device;
}

impl Lpips {
    /// Builds a network with these stages.
    pub(super) fn build(layout: &[StageLayout], source: &mut impl Source) -> Result<Self, ModelError> {
        let stages = layout.iter().enumerate().map(|(number, layout)| stage(number, layout, source));
        Ok(Self { stages: stages.collect::<Result<_, _>>()? })
    }

    /// A network with random weights. Its distances are meaningless, but its run time is realistic.
    pub fn random(backbone: Backbone, stream: &mut Stream, device: &Device) -> Self {
        // Proof: `build` fails only if its source fails, and `Noise` never does.
        Self::build(&backbone.layout(), &mut Noise { stream, device }).unwrap_or_else(|error| panic!("{error}"))
    }
}

fn stage(number: usize, layout: &StageLayout, source: &mut impl Source) -> Result<Stage, ModelError> {
    let convolutions = layout.convolutions.iter().map(|layout| convolution(layout, source));
    let convolutions = convolutions.collect::<Result<Vec<_>, _>>()?;
    let channels = layout.convolutions.last().map_or(0, |last| last.channels[1]);
    Ok(Stage {
        convolutions,
        weight: parameter(source, &format!("lin{number}.weight"), [1, channels, 1, 1])?,
        pool: layout.pool.map(|side| MaxPool2dConfig::new([side, side]).with_strides([2, 2]).init()),
    })
}

fn convolution(layout: &ConvolutionLayout, source: &mut impl Source) -> Result<Conv2d, ModelError> {
    let ConvolutionLayout { number, channels: [inputs, outputs], kernel, stride, padding } = *layout;
    Ok(Conv2d {
        weight: parameter(source, &format!("features.{number}.weight"), [outputs, inputs, kernel, kernel])?,
        bias: Some(parameter(source, &format!("features.{number}.bias"), [outputs])?),
        stride: [stride; 2],
        kernel_size: [kernel; 2],
        dilation: [1; 2],
        groups: 1,
        padding: PaddingConfig2d::Explicit(padding, padding, padding, padding),
    })
}

/// A constant parameter.
fn parameter<const D: usize>(
    source: &mut impl Source,
    name: &str,
    shape: [usize; D],
) -> Result<Param<Tensor<D>>, ModelError> {
    let numbers = source.numbers(name, &shape)?;
    let tensor = Tensor::from_data(numbers, (source.device(), DType::F32));
    Ok(Param::from_tensor(tensor).set_require_grad(false))
}

/// Weights that preserve the variance of activations (He et al. 2015), and positive channel weights.
pub(super) struct Noise<'a> {
    pub stream: &'a mut Stream,
    pub device: &'a Device,
}

impl Source for Noise<'_> {
    fn numbers(&mut self, name: &str, shape: &[usize]) -> Result<TensorData, ModelError> {
        let inputs: usize = shape.iter().skip(1).product();
        let bound = (6.0 / inputs as f64).sqrt();
        let low = if name.starts_with("lin") { 0.0 } else { -bound };
        let count = shape.iter().product();
        let values: Vec<f32> = (0..count).map(|_| self.stream.uniform(low, bound) as f32).collect();
        Ok(TensorData::new(values, shape.to_vec()))
    }

    fn device(&self) -> &Device {
        self.device
    }
}
