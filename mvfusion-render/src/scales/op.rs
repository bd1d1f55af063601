//! The cost of scales as a Burn backend extension.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::{ScaleRule, cpu};
use crate::Real;
use crate::host::HostBackend;
use crate::real::with_real;

/// The cost of scales.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait ScaleOps: Backend {
    /// `[1]`, with weights that are divided by the number of Gaussians.
    fn scale_cost(log_scales: FloatTensor<Self>, rule: ScaleRule) -> FloatTensor<Self>;
}

/// The adjoint; only on backends without autodiff.
pub(crate) trait ScaleAdjoint: ScaleOps {
    /// The adjoint of the log-scales for the cotangent `v_cost` `[1]`.
    fn scale_cost_backward(
        log_scales: FloatTensor<Self>,
        v_cost: FloatTensor<Self>,
        rule: ScaleRule,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> ScaleOps for B {
    fn scale_cost(log_scales: FloatTensor<Self>, rule: ScaleRule) -> FloatTensor<Self> {
        with_real!(log_scales.dtype(), T => {
            let cost = cpu::cost(&B::values::<T>(log_scales), &rule);
            B::tensor(vec![T::of(cost)], [1])
        })
    }
}

impl<B: HostBackend> ScaleAdjoint for B {
    fn scale_cost_backward(log_scales: FloatTensor<B>, v_cost: FloatTensor<B>, rule: ScaleRule) -> FloatTensor<B> {
        let shape = log_scales.shape();
        with_real!(log_scales.dtype(), T => {
            let v_cost = B::values::<T>(v_cost)[0];
            B::tensor(cpu::cost_backward(&B::values::<T>(log_scales), v_cost, &rule), shape)
        })
    }
}

#[derive(Debug)]
struct ScaleBackward;

impl<B: ScaleAdjoint> Backward<B, 1> for ScaleBackward {
    type State = (FloatTensor<B>, ScaleRule);

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (log_scales, rule) = ops.state;
        let v_cost = gradients.consume::<B>(&ops.node);
        let [node] = ops.parents;
        if let Some(node) = node {
            gradients.register::<B>(node.id, B::scale_cost_backward(log_scales, v_cost, rule));
        }
    }
}

impl<B: ScaleAdjoint, C: CheckpointStrategy> ScaleOps for Autodiff<B, C> {
    fn scale_cost(log_scales: FloatTensor<Self>, rule: ScaleRule) -> FloatTensor<Self> {
        let prepared = ScaleBackward.prepare::<C>([log_scales.node()]).compute_bound().stateful();
        let log_scales = log_scales.into_primitive();
        let cost = B::scale_cost(log_scales.clone(), rule);
        match prepared {
            OpsKind::Tracked(prepared) => prepared.finish((log_scales, rule), cost),
            OpsKind::UnTracked(prepared) => prepared.finish(cost),
        }
    }
}

pub(super) fn cost(log_scales: Tensor<2>, rule: ScaleRule) -> Tensor<1> {
    Tensor::from_dispatch(<Dispatch as ScaleOps>::scale_cost(log_scales.into_dispatch(), rule))
}
