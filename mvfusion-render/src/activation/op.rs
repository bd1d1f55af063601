//! The activations as a Burn backend extension.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, AutodiffBackend, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::cpu;
use crate::host::HostBackend;
use crate::real::with_real;

/// The activations.
// `sigmoid` would be ambiguous beside the operation of Burn.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait LogitOps: Backend {
    /// The logistic function of each number.
    fn logistic(logits: FloatTensor<Self>) -> FloatTensor<Self>;

    /// The share of the second of two `channels` in both, from logits `[N, C]`: `[N, 1]`, without a gradient.
    fn foreground_share(logits: FloatTensor<Self>, channels: [usize; 2]) -> FloatTensor<Self>;
}

/// The adjoint; only on backends without autodiff.
pub(crate) trait LogitAdjoint: LogitOps {
    /// The adjoint of the logits for the cotangents of their `probabilities`.
    fn logistic_backward(probabilities: FloatTensor<Self>, v_probabilities: FloatTensor<Self>) -> FloatTensor<Self>;
}

impl<B: HostBackend> LogitOps for B {
    fn logistic(logits: FloatTensor<Self>) -> FloatTensor<Self> {
        let shape = logits.shape();
        with_real!(logits.dtype(), T => B::tensor(cpu::logistic(&B::values::<T>(logits)), shape))
    }

    fn foreground_share(logits: FloatTensor<Self>, channels: [usize; 2]) -> FloatTensor<Self> {
        let [count, columns] = logits.shape().dims();
        with_real!(logits.dtype(), T => {
            B::tensor(cpu::foreground_share(&B::values::<T>(logits), columns, channels), [count, 1])
        })
    }
}

impl<B: HostBackend> LogitAdjoint for B {
    fn logistic_backward(probabilities: FloatTensor<Self>, v_probabilities: FloatTensor<Self>) -> FloatTensor<Self> {
        let shape = probabilities.shape();
        with_real!(probabilities.dtype(), T => {
            let v_logits = cpu::logistic_backward(&B::values::<T>(probabilities), &B::values::<T>(v_probabilities));
            B::tensor(v_logits, shape)
        })
    }
}

#[derive(Debug)]
struct LogisticBackward;

impl<B: LogitAdjoint> Backward<B, 1> for LogisticBackward {
    type State = FloatTensor<B>;

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let v_probabilities = gradients.consume::<B>(&ops.node);
        let [node] = ops.parents;
        if let Some(node) = node {
            gradients.register::<B>(node.id, B::logistic_backward(ops.state, v_probabilities));
        }
    }
}

impl<B: LogitAdjoint, C: CheckpointStrategy> LogitOps for Autodiff<B, C> {
    fn logistic(logits: FloatTensor<Self>) -> FloatTensor<Self> {
        let prepared = LogisticBackward.prepare::<C>([logits.node()]).compute_bound().stateful();
        let probabilities = B::logistic(logits.into_primitive());
        match prepared {
            OpsKind::Tracked(prepared) => prepared.finish(probabilities.clone(), probabilities),
            OpsKind::UnTracked(prepared) => prepared.finish(probabilities),
        }
    }

    fn foreground_share(logits: FloatTensor<Self>, channels: [usize; 2]) -> FloatTensor<Self> {
        Self::from_inner(B::foreground_share(logits.into_primitive(), channels))
    }
}

pub(super) fn logistic<const D: usize>(logits: Tensor<D>) -> Tensor<D> {
    Tensor::from_dispatch(<Dispatch as LogitOps>::logistic(logits.into_dispatch()))
}

pub(super) fn foreground_share(mask_logits: Tensor<2>, channels: [usize; 2]) -> Tensor<2> {
    Tensor::from_dispatch(<Dispatch as LogitOps>::foreground_share(mask_logits.into_dispatch(), channels))
}
