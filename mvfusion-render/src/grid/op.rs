//! HexPlane interpolation as a Burn backend extension.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::{GridBounds, GridLayout, cpu};
use crate::host::HostBackend;
use crate::profile::{self, Part};
use crate::real::with_real;

/// The forward pass.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait GridOps: Backend {
    /// See [`look_up`](super::look_up).
    fn grid_look_up(
        planes: FloatTensor<Self>,
        points: FloatTensor<Self>,
        times: FloatTensor<Self>,
        bounds: GridBounds,
        layout: GridLayout,
    ) -> FloatTensor<Self>;
}

/// The adjoint; only on backends without autodiff.
pub(crate) trait GridAdjoint: GridOps {
    /// `v_features` is `[N, scales * F]`.
    fn grid_look_up_backward(
        inputs: LookUp<Self>,
        v_features: FloatTensor<Self>,
        bounds: GridBounds,
        layout: GridLayout,
    ) -> LookUp<Self>;
}

/// The three differentiable arguments, or their adjoints.
#[derive(Clone, Debug)]
pub(crate) struct LookUp<B: Backend> {
    pub planes: FloatTensor<B>,
    pub points: FloatTensor<B>,
    pub times: FloatTensor<B>,
}

impl<B: HostBackend> GridOps for B {
    fn grid_look_up(
        planes: FloatTensor<Self>,
        points: FloatTensor<Self>,
        times: FloatTensor<Self>,
        bounds: GridBounds,
        layout: GridLayout,
    ) -> FloatTensor<Self> {
        let shape = [points.shape()[0], layout.feature_count()];
        with_real!(planes.dtype(), T => {
            let (planes, points, times) = (B::values::<T>(planes), B::values::<T>(points), B::values::<T>(times));
            let query = cpu::Query::new(&points, &times, &bounds);
            B::tensor(cpu::look_up(&planes, &query, &layout), shape)
        })
    }
}

impl<B: HostBackend> GridAdjoint for B {
    fn grid_look_up_backward(
        inputs: LookUp<B>,
        v_features: FloatTensor<B>,
        bounds: GridBounds,
        layout: GridLayout,
    ) -> LookUp<B> {
        let LookUp { planes, points, times } = inputs;
        let shapes = [planes.shape(), points.shape(), times.shape()];
        with_real!(planes.dtype(), T => {
            let (planes, points, times) = (B::values::<T>(planes), B::values::<T>(points), B::values::<T>(times));
            let query = cpu::Query::new(&points, &times, &bounds);
            let adjoint = cpu::look_up_backward(&planes, &query, &B::values::<T>(v_features), &layout);
            let [planes, points, times] = shapes;
            LookUp {
                planes: B::tensor(adjoint.planes, planes),
                points: B::tensor(adjoint.points, points),
                times: B::tensor(adjoint.times, times),
            }
        })
    }
}

#[derive(Debug)]
struct LookUpBackward;

impl<B: GridAdjoint> Backward<B, 3> for LookUpBackward {
    type State = (LookUp<B>, GridBounds, GridLayout, Option<Part>);

    fn backward(self, ops: Ops<Self::State, 3>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (inputs, bounds, layout, part) = ops.state;
        let v_features = gradients.consume::<B>(&ops.node);
        let adjoint = profile::measure_backward(part, || B::grid_look_up_backward(inputs, v_features, bounds, layout));
        let [planes, points, times] = ops.parents;
        for (node, adjoint) in [(planes, adjoint.planes), (points, adjoint.points), (times, adjoint.times)] {
            if let Some(node) = node {
                gradients.register::<B>(node.id, adjoint);
            }
        }
    }
}

impl<B: GridAdjoint, C: CheckpointStrategy> GridOps for Autodiff<B, C> {
    fn grid_look_up(
        planes: FloatTensor<Self>,
        points: FloatTensor<Self>,
        times: FloatTensor<Self>,
        bounds: GridBounds,
        layout: GridLayout,
    ) -> FloatTensor<Self> {
        let nodes = [planes.node(), points.node(), times.node()];
        let prepared = LookUpBackward.prepare::<C>(nodes).compute_bound().stateful();
        let inputs: LookUp<B> =
            LookUp { planes: planes.into_primitive(), points: points.into_primitive(), times: times.into_primitive() };
        let LookUp { planes, points, times } = inputs.clone();
        let features = B::grid_look_up(planes, points, times, bounds, layout.clone());
        match prepared {
            OpsKind::Tracked(prepared) => prepared.finish((inputs, bounds, layout, profile::current()), features),
            OpsKind::UnTracked(prepared) => prepared.finish(features),
        }
    }
}

pub(super) fn look_up(
    planes: Tensor<2>,
    points: Tensor<2>,
    times: Tensor<2>,
    bounds: &GridBounds,
    layout: &GridLayout,
) -> Tensor<2> {
    let (planes, points, times) = (planes.into_dispatch(), points.into_dispatch(), times.into_dispatch());
    Tensor::from_dispatch(<Dispatch as GridOps>::grid_look_up(planes, points, times, *bounds, layout.clone()))
}
