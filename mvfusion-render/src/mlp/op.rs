//! The MLPs as a Burn backend extension.

use std::ops::Deref;

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::cpu::{self, Wanted, Weights};
use super::{Layer, MAX_LAYERS, MlpLayout};
use crate::host::HostBackend;
use crate::list::{self, Floats};
use crate::profile::{self, Part};
use crate::real::with_real;

/// The forward pass.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait MlpOps: Backend {
    /// See [`forward`](super::forward).
    fn mlp_forward(
        input: FloatTensor<Self>,
        #[extension_type] parameters: Floats<Self>,
        layout: MlpLayout,
    ) -> FloatTensor<Self>;
}

/// The adjoint; only on backends without autodiff.
pub(crate) trait MlpAdjoint: MlpOps {
    /// The forward pass, and what the adjoint then need not compute again: nothing, or the outputs of all hidden layers.
    fn mlp_forward_kept(
        input: FloatTensor<Self>,
        parameters: Floats<Self>,
        layout: MlpLayout,
    ) -> (FloatTensor<Self>, Floats<Self>) {
        (Self::mlp_forward(input, parameters, layout), Floats(Vec::new()))
    }

    /// The requested adjoints of input and parameters. `v_outputs` is `[N, outputs]`, and `kept` comes from the forward
    /// pass.
    fn mlp_backward(
        arguments: Arguments<Self>,
        kept: Floats<Self>,
        v_outputs: FloatTensor<Self>,
        layout: MlpLayout,
        wanted: Wanted,
    ) -> Adjoints<Self>;
}

/// The differentiable arguments.
#[derive(Clone, Debug)]
pub(crate) struct Arguments<B: Backend> {
    pub input: FloatTensor<B>,
    /// Weight and bias of each layer.
    pub parameters: Floats<B>,
}

/// The requested adjoints of the arguments.
pub(crate) struct Adjoints<B: Backend> {
    pub input: Option<FloatTensor<B>>,
    pub parameters: Option<Floats<B>>,
}

/// Parents of the backward step: the input, then weight and bias of each layer.
const PARENTS: usize = 1 + 2 * MAX_LAYERS;

impl<B: HostBackend> MlpOps for B {
    fn mlp_forward(input: FloatTensor<Self>, parameters: Floats<Self>, layout: MlpLayout) -> FloatTensor<Self> {
        let shape = [input.shape()[0], layout.outputs()];
        with_real!(input.dtype(), T => {
            let parameters: Vec<_> = parameters.0.into_iter().map(B::values::<T>).collect();
            B::tensor(cpu::forward(&B::values::<T>(input), &weights(&parameters), &layout), shape)
        })
    }
}

impl<B: HostBackend> MlpAdjoint for B {
    fn mlp_backward(
        arguments: Arguments<B>,
        _kept: Floats<B>,
        v_outputs: FloatTensor<B>,
        layout: MlpLayout,
        wanted: Wanted,
    ) -> Adjoints<B> {
        let Arguments { input, parameters } = arguments;
        let shape = input.shape();
        let shapes: Vec<_> = parameters.0.iter().map(TensorMetadata::shape).collect();
        with_real!(input.dtype(), T => {
            let parameters: Vec<_> = parameters.0.into_iter().map(B::values::<T>).collect();
            let (input, v_outputs) = (B::values::<T>(input), B::values::<T>(v_outputs));
            let adjoint = cpu::backward(&input, &weights(&parameters), &v_outputs, &layout, wanted);
            let of_parameters = |adjoints: Vec<Vec<T>>| {
                Floats(adjoints.into_iter().zip(shapes).map(|(v, shape)| B::tensor(v, shape)).collect())
            };
            Adjoints {
                input: adjoint.input.map(|v| B::tensor(v, shape)),
                parameters: adjoint.parameters.map(of_parameters),
            }
        })
    }
}

/// The parameters of each layer, from weights and biases in turns.
fn weights<T, V: Deref<Target = [T]>>(parameters: &[V]) -> Vec<Weights<'_, T>> {
    parameters.chunks_exact(2).map(|pair| Weights { weight: &pair[0], bias: &pair[1] }).collect()
}

#[derive(Debug)]
struct MlpBackward;

impl<B: MlpAdjoint> Backward<B, PARENTS> for MlpBackward {
    type State = (Arguments<B>, Floats<B>, MlpLayout, Option<Part>);

    fn backward(self, ops: Ops<Self::State, PARENTS>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (arguments, kept, layout, part) = ops.state;
        let v_outputs = gradients.consume::<B>(&ops.node);
        let [input, parameters @ ..] = ops.parents;
        let wanted = Wanted { input: input.is_some(), parameters: parameters.iter().any(Option::is_some) };
        let adjoints = profile::measure_backward(part, || B::mlp_backward(arguments, kept, v_outputs, layout, wanted));
        let of_parameters = parameters.into_iter().zip(adjoints.parameters.into_iter().flat_map(|list| list.0));
        for (node, adjoint) in std::iter::once(input).zip(adjoints.input).chain(of_parameters) {
            if let Some(node) = node {
                gradients.register::<B>(node.id, adjoint);
            }
        }
    }
}

impl<B: MlpAdjoint, C: CheckpointStrategy> MlpOps for Autodiff<B, C> {
    fn mlp_forward(input: FloatTensor<Self>, parameters: Floats<Self>, layout: MlpLayout) -> FloatTensor<Self> {
        let nodes = list::parents(std::iter::once(&input).chain(&parameters.0));
        let prepared = MlpBackward.prepare::<C>(nodes).compute_bound().stateful();
        let parameters = Floats(parameters.0.into_iter().map(|parameter| parameter.into_primitive()).collect());
        let arguments: Arguments<B> = Arguments { input: input.into_primitive(), parameters };
        let Arguments { input, parameters } = arguments.clone();
        match prepared {
            OpsKind::Tracked(prepared) => {
                let (outputs, kept) = B::mlp_forward_kept(input, parameters, layout.clone());
                prepared.finish((arguments, kept, layout, profile::current()), outputs)
            }
            OpsKind::UnTracked(prepared) => prepared.finish(B::mlp_forward(input, parameters, layout)),
        }
    }
}

pub(super) fn forward(input: Tensor<2>, layers: Vec<Layer>, layout: &MlpLayout) -> Tensor<2> {
    let parameters =
        layers.into_iter().flat_map(|Layer { weight, bias }| [weight.into_dispatch(), bias.into_dispatch()]);
    let parameters = Floats(parameters.collect());
    Tensor::from_dispatch(<Dispatch as MlpOps>::mlp_forward(input.into_dispatch(), parameters, layout.clone()))
}
