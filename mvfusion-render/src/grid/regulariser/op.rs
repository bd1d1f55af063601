//! The grid penalties as a Burn backend extension: one op with three results.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::cpu;
use crate::Real;
use crate::grid::GridLayout;
use crate::host::HostBackend;
use crate::real::with_real;

/// The penalties of a grid's planes.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait PenaltyOps: Backend {
    /// `[3]`: plane smoothness, time smoothness, distance of the time planes from 1.
    fn grid_penalties(planes: FloatTensor<Self>, layout: GridLayout) -> FloatTensor<Self>;
}

/// The adjoint; only on backends without autodiff.
pub(crate) trait PenaltyAdjoint: PenaltyOps {
    /// The adjoint of the planes for the cotangents `v_terms` `[3]`.
    fn grid_penalties_backward(
        planes: FloatTensor<Self>,
        v_terms: FloatTensor<Self>,
        layout: GridLayout,
    ) -> FloatTensor<Self>;
}

impl<B: HostBackend> PenaltyOps for B {
    fn grid_penalties(planes: FloatTensor<Self>, layout: GridLayout) -> FloatTensor<Self> {
        with_real!(planes.dtype(), T => {
            let terms = cpu::penalties(&B::values::<T>(planes), &layout);
            B::tensor(terms.map(T::of).to_vec(), [3])
        })
    }
}

impl<B: HostBackend> PenaltyAdjoint for B {
    fn grid_penalties_backward(planes: FloatTensor<B>, v_terms: FloatTensor<B>, layout: GridLayout) -> FloatTensor<B> {
        let shape = planes.shape();
        with_real!(planes.dtype(), T => {
            let v_terms = B::values::<T>(v_terms);
            let v_terms = [v_terms[0], v_terms[1], v_terms[2]];
            B::tensor(cpu::penalties_backward(&B::values::<T>(planes), v_terms, &layout), shape)
        })
    }
}

#[derive(Debug)]
struct PenaltyBackward;

impl<B: PenaltyAdjoint> Backward<B, 1> for PenaltyBackward {
    type State = (FloatTensor<B>, GridLayout);

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (planes, layout) = ops.state;
        let v_terms = gradients.consume::<B>(&ops.node);
        let [node] = ops.parents;
        if let Some(node) = node {
            gradients.register::<B>(node.id, B::grid_penalties_backward(planes, v_terms, layout));
        }
    }
}

impl<B: PenaltyAdjoint, C: CheckpointStrategy> PenaltyOps for Autodiff<B, C> {
    fn grid_penalties(planes: FloatTensor<Self>, layout: GridLayout) -> FloatTensor<Self> {
        let prepared = PenaltyBackward.prepare::<C>([planes.node()]).compute_bound().stateful();
        let planes = planes.into_primitive();
        let terms = B::grid_penalties(planes.clone(), layout.clone());
        match prepared {
            OpsKind::Tracked(prepared) => prepared.finish((planes, layout), terms),
            OpsKind::UnTracked(prepared) => prepared.finish(terms),
        }
    }
}

pub(super) fn penalties(planes: Tensor<2>, layout: &GridLayout) -> Tensor<1> {
    Tensor::from_dispatch(<Dispatch as PenaltyOps>::grid_penalties(planes.into_dispatch(), layout.clone()))
}
