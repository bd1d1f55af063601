//! Attention as a Burn backend extension.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::cpu::{self, Layout};
use crate::host::HostBackend;
use crate::profile::{self, Part};
use crate::real::with_real;

/// The forward pass.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait AttentionOps: Backend {
    /// See [`forward`](super::forward).
    fn attention_forward(queries: FloatTensor<Self>, memory: FloatTensor<Self>, heads: usize) -> FloatTensor<Self>;
}

/// The adjoint; only on backends without autodiff.
pub(crate) trait AttentionAdjoint: AttentionOps {
    /// The adjoints of queries and memory. `v_found` is `[N, queries, width]`.
    fn attention_backward(
        arguments: Arguments<Self>,
        v_found: FloatTensor<Self>,
        heads: usize,
    ) -> [FloatTensor<Self>; 2];
}

/// The two differentiable arguments.
#[derive(Clone, Debug)]
pub(crate) struct Arguments<B: Backend> {
    pub queries: FloatTensor<B>,
    pub memory: FloatTensor<B>,
}

impl<B: Backend> Arguments<B> {
    pub fn layout(&self, heads: usize) -> Layout {
        let [_, queries, width] = self.queries.shape().dims();
        Layout { width, queries, keys: self.memory.shape()[1], heads }
    }
}

impl<B: HostBackend> AttentionOps for B {
    fn attention_forward(queries: FloatTensor<Self>, memory: FloatTensor<Self>, heads: usize) -> FloatTensor<Self> {
        let arguments = Arguments::<B> { queries, memory };
        let (layout, shape) = (arguments.layout(heads), arguments.queries.shape());
        with_real!(arguments.queries.dtype(), T => {
            let (queries, memory) = (B::values::<T>(arguments.queries), B::values::<T>(arguments.memory));
            B::tensor(cpu::forward(&queries, &memory, layout), shape)
        })
    }
}

impl<B: HostBackend> AttentionAdjoint for B {
    fn attention_backward(arguments: Arguments<B>, v_found: FloatTensor<B>, heads: usize) -> [FloatTensor<B>; 2] {
        let layout = arguments.layout(heads);
        let shapes = [arguments.queries.shape(), arguments.memory.shape()];
        with_real!(arguments.queries.dtype(), T => {
            let (queries, memory) = (B::values::<T>(arguments.queries), B::values::<T>(arguments.memory));
            let adjoint = cpu::backward(&queries, &memory, &B::values::<T>(v_found), layout);
            let [queries, memory] = shapes;
            [B::tensor(adjoint.queries, queries), B::tensor(adjoint.memory, memory)]
        })
    }
}

#[derive(Debug)]
struct AttentionBackward;

impl<B: AttentionAdjoint> Backward<B, 2> for AttentionBackward {
    type State = (Arguments<B>, usize, Option<Part>);

    fn backward(self, ops: Ops<Self::State, 2>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (arguments, heads, part) = ops.state;
        let v_found = gradients.consume::<B>(&ops.node);
        let adjoints = profile::measure_backward(part, || B::attention_backward(arguments, v_found, heads));
        for (node, adjoint) in ops.parents.into_iter().zip(adjoints) {
            if let Some(node) = node {
                gradients.register::<B>(node.id, adjoint);
            }
        }
    }
}

impl<B: AttentionAdjoint, C: CheckpointStrategy> AttentionOps for Autodiff<B, C> {
    fn attention_forward(queries: FloatTensor<Self>, memory: FloatTensor<Self>, heads: usize) -> FloatTensor<Self> {
        let prepared = AttentionBackward.prepare::<C>([queries.node(), memory.node()]).compute_bound().stateful();
        let arguments: Arguments<B> = Arguments { queries: queries.into_primitive(), memory: memory.into_primitive() };
        let Arguments { queries, memory } = arguments.clone();
        let found = B::attention_forward(queries, memory, heads);
        match prepared {
            OpsKind::Tracked(prepared) => prepared.finish((arguments, heads, profile::current()), found),
            OpsKind::UnTracked(prepared) => prepared.finish(found),
        }
    }
}

pub(super) fn forward(queries: Tensor<3>, memory: Tensor<3>, heads: usize) -> Tensor<3> {
    let (queries, memory) = (queries.into_dispatch(), memory.into_dispatch());
    Tensor::from_dispatch(<Dispatch as AttentionOps>::attention_forward(queries, memory, heads))
}
