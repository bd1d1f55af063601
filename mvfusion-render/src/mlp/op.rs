//! The MLPs as a Burn backend extension.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::cpu::Wanted;
use super::{MlpLayout, cpu};
use crate::host::HostBackend;
use crate::profile::{self, Part};
use crate::real::with_real;

/// The forward pass.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait MlpOps: Backend {
    /// See [`forward`](super::forward).
    fn mlp_forward(input: FloatTensor<Self>, parameters: FloatTensor<Self>, layout: MlpLayout) -> FloatTensor<Self>;
}

/// The adjoint; only on backends without autodiff.
pub(crate) trait MlpAdjoint: MlpOps {
    /// The requested adjoints of input and parameters. `v_outputs` is `[N, outputs]`.
    fn mlp_backward(
        arguments: Arguments<Self>,
        v_outputs: FloatTensor<Self>,
        layout: MlpLayout,
        wanted: Wanted,
    ) -> [Option<FloatTensor<Self>>; 2];
}

/// The two differentiable arguments.
#[derive(Clone, Debug)]
pub(crate) struct Arguments<B: Backend> {
    pub input: FloatTensor<B>,
    pub parameters: FloatTensor<B>,
}

impl<B: HostBackend> MlpOps for B {
    fn mlp_forward(input: FloatTensor<Self>, parameters: FloatTensor<Self>, layout: MlpLayout) -> FloatTensor<Self> {
        let shape = [input.shape()[0], layout.outputs()];
        with_real!(input.dtype(), T => {
            let (input, parameters) = (B::values::<T>(input), B::values::<T>(parameters));
            B::tensor(cpu::forward(&input, &parameters, &layout), shape)
        })
    }
}

impl<B: HostBackend> MlpAdjoint for B {
    fn mlp_backward(
        arguments: Arguments<B>,
        v_outputs: FloatTensor<B>,
        layout: MlpLayout,
        wanted: Wanted,
    ) -> [Option<FloatTensor<B>>; 2] {
        let Arguments { input, parameters } = arguments;
        let shapes = [input.shape(), parameters.shape()];
        with_real!(input.dtype(), T => {
            let (input, parameters) = (B::values::<T>(input), B::values::<T>(parameters));
            let v_outputs = B::values::<T>(v_outputs);
            let adjoint = cpu::backward(&input, &parameters, &v_outputs, &layout, wanted);
            let [input, parameters] = shapes;
            [adjoint.input.map(|v| B::tensor(v, input)), adjoint.parameters.map(|v| B::tensor(v, parameters))]
        })
    }
}

#[derive(Debug)]
struct MlpBackward;

impl<B: MlpAdjoint> Backward<B, 2> for MlpBackward {
    type State = (Arguments<B>, MlpLayout, Option<Part>);

    fn backward(self, ops: Ops<Self::State, 2>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (arguments, layout, part) = ops.state;
        let v_outputs = gradients.consume::<B>(&ops.node);
        let wanted = Wanted { input: ops.parents[0].is_some(), parameters: ops.parents[1].is_some() };
        let adjoints = profile::measure_backward(part, || B::mlp_backward(arguments, v_outputs, layout, wanted));
        for (node, adjoint) in ops.parents.into_iter().zip(adjoints) {
            if let (Some(node), Some(adjoint)) = (node, adjoint) {
                gradients.register::<B>(node.id, adjoint);
            }
        }
    }
}

impl<B: MlpAdjoint, C: CheckpointStrategy> MlpOps for Autodiff<B, C> {
    fn mlp_forward(input: FloatTensor<Self>, parameters: FloatTensor<Self>, layout: MlpLayout) -> FloatTensor<Self> {
        let prepared = MlpBackward.prepare::<C>([input.node(), parameters.node()]).compute_bound().stateful();
        let arguments: Arguments<B> =
            Arguments { input: input.into_primitive(), parameters: parameters.into_primitive() };
        let Arguments { input, parameters } = arguments.clone();
        let outputs = B::mlp_forward(input, parameters, layout.clone());
        match prepared {
            OpsKind::Tracked(prepared) => prepared.finish((arguments, layout, profile::current()), outputs),
            OpsKind::UnTracked(prepared) => prepared.finish(outputs),
        }
    }
}

pub(super) fn forward(input: Tensor<2>, parameters: Tensor<1>, layout: &MlpLayout) -> Tensor<2> {
    let (input, parameters) = (input.into_dispatch(), parameters.into_dispatch());
    Tensor::from_dispatch(<Dispatch as MlpOps>::mlp_forward(input, parameters, layout.clone()))
}
