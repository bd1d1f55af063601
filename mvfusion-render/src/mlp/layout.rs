//! Which layers a bundle of perceptrons has, and where their parameters lie.

use std::ops::Range;

/// Perceptrons that read the same rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MlpLayout {
    /// Columns of the input.
    pub inputs: usize,
    /// Whether the input passes a ReLU first.
    pub rectified: bool,
    /// For each chain the output widths of its layers, first to last.
    pub chains: Vec<Vec<usize>>,
}

/// One linear layer within the parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct LinearLayout {
    /// Width of its input.
    pub inputs: usize,
    /// Width of its output.
    pub outputs: usize,
    /// Where its weight `[inputs, outputs]` lies.
    pub weight: Range<usize>,
    /// Where its bias `[outputs]` lies.
    pub bias: Range<usize>,
}

impl MlpLayout {
    /// Columns of the result: those of all chains.
    pub fn outputs(&self) -> usize {
        self.chains.iter().filter_map(|widths| widths.last()).sum()
    }

    /// Numbers that all layers need together.
    pub fn parameters(&self) -> usize {
        self.layers().iter().flatten().map(|layer| layer.bias.end).max().unwrap_or(0)
    }

    /// The layers of each chain.
    pub(crate) fn layers(&self) -> Vec<Vec<LinearLayout>> {
        let mut at = 0;
        let mut layer = |inputs: usize, outputs: usize| {
            let weight = at..at + inputs * outputs;
            at = weight.end + outputs;
            LinearLayout { inputs, outputs, bias: weight.end..at, weight }
        };
        let mut chain = |widths: &Vec<usize>| {
            let inputs = std::iter::once(&self.inputs).chain(widths);
            inputs.zip(widths).map(|(&inputs, &outputs)| layer(inputs, outputs)).collect()
        };
        self.chains.iter().map(&mut chain).collect()
    }
}
