//! The layers of a group of MLPs, and the positions of their parameters.

use std::ops::Range;

/// MLPs that read the same rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MlpLayout {
    /// Columns of the input.
    pub inputs: usize,
    /// Whether the input first passes through a ReLU.
    pub rectified: bool,
    /// The output widths of each chain's layers, first to last.
    pub chains: Vec<Vec<usize>>,
}

/// One linear layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct LinearLayout {
    /// Number of layers before it, in this chain and in earlier ones.
    pub index: usize,
    /// Width of the input.
    pub inputs: usize,
    /// Width of the output.
    pub outputs: usize,
    /// Range of the weight `[inputs, outputs]` if all parameters are joined.
    pub weight: Range<usize>,
    /// Range of the bias `[outputs]` then; it follows the weight.
    pub bias: Range<usize>,
}

impl MlpLayout {
    /// Columns of the result, summed over the chains.
    pub fn outputs(&self) -> usize {
        self.chains.iter().filter_map(|widths| widths.last()).sum()
    }

    /// Number of parameters of all layers.
    pub fn parameters(&self) -> usize {
        self.layers().iter().flatten().map(|layer| layer.bias.end).max().unwrap_or(0)
    }

    /// The layers of each chain.
    pub(crate) fn layers(&self) -> Vec<Vec<LinearLayout>> {
        self.aligned_layers(1)
    }

    /// The layers of each chain. If all parameters are joined, each weight begins at a multiple of `alignment`.
    pub(crate) fn aligned_layers(&self, alignment: usize) -> Vec<Vec<LinearLayout>> {
        let (mut at, mut index) = (0_usize, 0);
        let mut layer = |inputs: usize, outputs: usize| {
            let start = at.next_multiple_of(alignment);
            let weight = start..start + inputs * outputs;
            at = weight.end + outputs;
            index += 1;
            LinearLayout { index: index - 1, inputs, outputs, bias: weight.end..at, weight }
        };
        let mut chain = |widths: &Vec<usize>| {
            let inputs = std::iter::once(&self.inputs).chain(widths);
            inputs.zip(widths).map(|(&inputs, &outputs)| layer(inputs, outputs)).collect()
        };
        self.chains.iter().map(&mut chain).collect()
    }

    /// The ranges of weight and bias of each layer if all parameters are joined.
    pub(crate) fn ranges(&self) -> Vec<Range<usize>> {
        self.layers().into_iter().flatten().flat_map(|layer| [layer.weight, layer.bias]).collect()
    }
}
