//! The MLPs, one launch per layer. CPU twin: `mlp/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn::tensor::DType;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::CubeDim;
use mvfusion_kernels::cube::matrix::MatrixLayoutLaunch;
use mvfusion_kernels::cube::product::{ProductSizeLaunch, product};
use mvfusion_kernels::cube::product_kind::{End, ProductKind};
use mvfusion_kernels::cube::stage::FOUR;

use super::gpu::{Flat, Gpu, single};
use crate::list::Floats;
use crate::mlp::MlpLayout;
use crate::mlp::cpu::Wanted;
use crate::mlp::layout::LinearLayout;
use crate::mlp::op::{Adjoints, Arguments, MlpAdjoint, MlpOps};

/// Most bytes of hidden rows that a call keeps for its adjoint, which otherwise computes them again.
const MOST_KEPT: usize = 512 << 20;

/// Most slabs of rows for the adjoint of a weight.
const MOST_SLABS: usize = 128;

impl MlpOps for CubeBackend {
    fn mlp_forward(input: FloatTensor<Self>, parameters: Floats<Self>, layout: MlpLayout) -> FloatTensor<Self> {
        Run::new(input, parameters, &layout).forward(layout.outputs(), |_| ())
    }
}

impl MlpAdjoint for CubeBackend {
    fn mlp_forward_kept(
        input: FloatTensor<Self>,
        parameters: Floats<Self>,
        layout: MlpLayout,
    ) -> (FloatTensor<Self>, Floats<Self>) {
        let run = Run::new(input, parameters, &layout);
        let is_kept = run.hidden_bytes() <= MOST_KEPT;
        let mut kept = Vec::new();
        let outputs = run.forward(layout.outputs(), |hidden| {
            if is_kept {
                kept.extend(hidden.into_iter().map(|matrix| matrix.tensor));
            }
        });
        (outputs, Floats(kept))
    }

    fn mlp_backward(
        arguments: Arguments<Self>,
        kept: Floats<Self>,
        v_outputs: FloatTensor<Self>,
        layout: MlpLayout,
        wanted: Wanted,
    ) -> Adjoints<Self> {
        let Arguments { input, parameters } = arguments;
        let run = Run::new(input, parameters, &layout);
        if run.rows == 0 {
            return Adjoints {
                input: wanted.input.then(|| run.input.tensor.clone()),
                parameters: wanted.parameters.then(|| run.apart(run.gpu.zero_floats([run.joined]))),
            };
        }
        let v_outputs = single(v_outputs);
        let v_input = wanted.input.then(|| Matrix::of(run.gpu.floats(run.input.tensor.shape())));
        let shares = wanted.parameters.then(|| run.gpu.floats([run.rows.div_ceil(run.slab()), run.joined]));
        let mut column = 0;
        let mut kept = kept.0.into_iter().peekable();
        for (number, chain) in run.layers.iter().enumerate() {
            let hidden = match kept.peek() {
                Some(_) => kept.by_ref().take(chain.len() - 1).map(Matrix::of).collect(),
                None => run.hidden(chain),
            };
            let mut v = Matrix::columns(&v_outputs, column, chain[chain.len() - 1].outputs);
            column += v.columns;
            for (index, layer) in chain.iter().enumerate().rev() {
                let source = index.checked_sub(1).map_or(&run.input, |before| &hidden[before]);
                if let Some(shares) = &shares {
                    run.weight_adjoint(source, &v, layer, shares);
                }
                if index > 0 {
                    let v_source = Matrix::of(run.gpu.floats([run.rows, layer.inputs]));
                    run.source_adjoint(&v, layer, source, End::Adjoint { gated: true, added: false }, &v_source);
                    v = v_source;
                } else if let Some(v_input) = &v_input {
                    let end = End::Adjoint { gated: layout.rectified, added: number > 0 };
                    run.source_adjoint(&v, layer, source, end, v_input);
                }
            }
        }
        Adjoints {
            input: v_input.map(|matrix| matrix.tensor),
            parameters: shares.map(|shares| run.apart(run.gpu.sum_rows(shares))),
        }
    }
}

/// A matrix in a buffer.
struct Matrix {
    tensor: CubeTensor,
    columns: usize,
    /// Index of its first value in the buffer.
    first: usize,
    /// Distance from one row to the next.
    stride: usize,
}

impl Matrix {
    /// A tensor `[rows, columns]`.
    fn of(tensor: CubeTensor) -> Self {
        let columns = tensor.shape()[1];
        Self { tensor, columns, first: 0, stride: columns }
    }

    /// Some columns of a tensor.
    fn columns(tensor: &CubeTensor, first: usize, columns: usize) -> Self {
        Self { tensor: tensor.clone(), columns, first, stride: tensor.shape()[1] }
    }

    /// The layout as a kernel argument.
    fn layout(&self) -> MatrixLayoutLaunch {
        MatrixLayoutLaunch::new(self.first as u32, self.stride as u32)
    }

    /// Whether each four columns lie where a kernel can read them together.
    fn is_in_fours(&self) -> bool {
        [self.first, self.stride, self.columns].iter().all(|number| number.is_multiple_of(FOUR))
    }
}

/// The arguments of a pass.
struct Run {
    gpu: Gpu,
    input: Matrix,
    /// The layers of each chain. In the joined adjoints, weights begin where buffers may be bound.
    layers: Vec<Vec<LinearLayout>>,
    /// Length of the joined adjoints.
    joined: usize,
    /// Weight and bias of each layer.
    parameters: Vec<CubeTensor>,
    rows: usize,
    /// Whether negative values of the input count as zero.
    rectified: bool,
}

impl Run {
    fn new(input: CubeTensor, parameters: Floats<CubeBackend>, layout: &MlpLayout) -> Self {
        let gpu = Gpu::of(&input);
        let rows = input.shape()[0];
        let input = Matrix::of(single(input));
        let parameters = parameters.0.into_iter().map(single).collect();
        let layers = layout.aligned_layers(gpu.alignment(DType::F32));
        let joined = layers.iter().flatten().map(|layer| layer.bias.end).max().unwrap_or(0);
        Self { gpu, input, layers, joined, parameters, rows, rectified: layout.rectified }
    }

    /// The weight of a layer, `[inputs, outputs]`.
    fn weight(&self, layer: &LinearLayout) -> Matrix {
        Matrix::of(self.parameters[2 * layer.index].clone())
    }

    /// Rows that a cube sums for the adjoint of a weight, the same for all layers. The sums of all slabs fit into a
    /// buffer.
    fn slab(&self) -> usize {
        let fit = self.gpu.buffer_limit() / (DType::F32.size() * self.joined.max(1)) as u64;
        let slabs = (MOST_SLABS as u64).min(fit.max(1)) as usize;
        self.rows.div_ceil(slabs).max(self.gpu.product_plan([1, 1]).least_slab)
    }

    /// The adjoints of the parameters, which share one tensor.
    fn apart(&self, joined: CubeTensor) -> Floats<CubeBackend> {
        let ranges = self.layers.iter().flatten().flat_map(|layer| [layer.weight.clone(), layer.bias.clone()]);
        let own = ranges.zip(&self.parameters).map(|(range, own)| self.gpu.part(&joined, range, own.shape()));
        Floats(own.collect())
    }

    /// The outputs `[rows, outputs]`. `done` takes the hidden rows of each chain.
    fn forward(&self, outputs: usize, mut done: impl FnMut(Vec<Matrix>)) -> CubeTensor {
        let outputs = self.gpu.floats([self.rows, outputs]);
        let mut column = 0;
        for chain in &self.layers {
            let hidden = self.hidden(chain);
            let last = &chain[chain.len() - 1];
            let source = hidden.last().unwrap_or(&self.input);
            self.layer(source, last, false, &Matrix::columns(&outputs, column, last.outputs));
            column += last.outputs;
            done(hidden);
        }
        outputs
    }

    /// Bytes of the hidden rows of all chains.
    fn hidden_bytes(&self) -> usize {
        let widths = self.layers.iter().flat_map(|chain| &chain[..chain.len() - 1]).map(|layer| layer.outputs);
        self.rows * widths.sum::<usize>() * DType::F32.size()
    }

    /// The rectified outputs of all layers of a chain except the last.
    fn hidden(&self, chain: &[LinearLayout]) -> Vec<Matrix> {
        let mut hidden: Vec<Matrix> = Vec::new();
        for layer in &chain[..chain.len() - 1] {
            let result = Matrix::of(self.gpu.floats([self.rows, layer.outputs]));
            self.layer(hidden.last().unwrap_or(&self.input), layer, true, &result);
            hidden.push(result);
        }
        hidden
    }

    /// Whether a layer reads the input and its negative values count as zero.
    fn is_rectified(&self, source: &Matrix) -> bool {
        self.rectified && std::ptr::eq(source, &self.input)
    }

    /// `source W + b`.
    fn layer(&self, source: &Matrix, layer: &LinearLayout, rectified: bool, result: &Matrix) {
        self.launch(Product {
            left: source,
            right: &self.weight(layer),
            bias: Some(&self.parameters[2 * layer.index + 1]),
            size: [self.rows, layer.outputs, layer.inputs],
            result,
            gate: source,
            rectified: self.is_rectified(source),
            end: End::Layer { rectified },
        });
    }

    /// The adjoint of a layer's source, `v Wᵀ`.
    fn source_adjoint(&self, v: &Matrix, layer: &LinearLayout, source: &Matrix, end: End, result: &Matrix) {
        self.launch(Product {
            left: v,
            right: &self.weight(layer),
            bias: None,
            size: [self.rows, layer.inputs, layer.outputs],
            result,
            gate: source,
            rectified: false,
            end,
        });
    }

    /// The slabs' partial sums of the adjoint of a layer's weight, `sourceᵀ v`, and of its bias, the sum of v. The bias
    /// follows the weight as another row.
    fn weight_adjoint(&self, source: &Matrix, v: &Matrix, layer: &LinearLayout, shares: &CubeTensor) {
        let result =
            Matrix { tensor: shares.clone(), columns: layer.outputs, first: layer.weight.start, stride: layer.outputs };
        self.launch(Product {
            left: source,
            right: v,
            bias: None,
            size: [layer.inputs, layer.outputs, self.rows],
            result: &result,
            gate: source,
            rectified: self.is_rectified(source),
            end: End::Slabs,
        });
    }

    fn launch(&self, of: Product<'_>) {
        let [rows, columns, depth] = of.size;
        if rows == 0 {
            return;
        }
        let kind = ProductKind::new(
            self.gpu.product_plan([rows, columns]),
            columns,
            of.rectified,
            of.end,
            self.gpu.shared_memory(),
        );
        let slab = if of.end == End::Slabs { self.slab() } else { depth };
        let tiles = rows.div_ceil(kind.tile_rows()) * columns.div_ceil(kind.tile_columns());
        let slab_stride = of.result.tensor.shape()[1];
        let gated = matches!(of.end, End::Adjoint { gated: true, .. });
        let results_in_fours = of.result.is_in_fours()
            && (of.end != End::Slabs || slab_stride.is_multiple_of(FOUR))
            && (!gated || of.gate.is_in_fours());
        // A gate that is not read is bound as if it were, so it must not be too short for a vector. The right matrix has a
        // row or column of the result's columns.
        let gate = if gated { of.gate } else { of.right };
        let vector = |in_fours| if in_fours { FOUR } else { 1 };
        // SAFETY: rows, columns and depth are those of the matrices, and the kernel neither reads nor writes beyond
        // them.
        unsafe {
            product::launch_unchecked(
                &self.gpu.client,
                self.gpu.cubes(tiles * depth.div_ceil(slab)),
                CubeDim::new_1d(kind.units as u32),
                vector(of.left.is_in_fours()),
                vector(of.right.is_in_fours()),
                vector(results_in_fours),
                of.left.tensor.clone().flat(),
                of.right.tensor.clone().flat(),
                of.bias.unwrap_or(&of.right.tensor).clone().flat(),
                gate.tensor.clone().flat(),
                of.result.tensor.clone().flat(),
                ProductSizeLaunch::new(rows as u32, columns as u32, depth as u32, slab as u32),
                of.left.layout(),
                of.right.layout(),
                of.result.layout(),
                gate.layout(),
                slab_stride as u32,
                kind,
            );
        }
    }
}

/// A product to launch.
struct Product<'a> {
    /// In the adjoint of a weight, the transpose of the left matrix.
    left: &'a Matrix,
    /// In the adjoint of a source, the transpose of the right matrix.
    right: &'a Matrix,
    /// The bias of a layer.
    bias: Option<&'a CubeTensor>,
    /// Rows, columns, depth.
    size: [usize; 3],
    result: &'a Matrix,
    gate: &'a Matrix,
    /// Whether negative values of the left matrix count as zero.
    rectified: bool,
    end: End,
}
