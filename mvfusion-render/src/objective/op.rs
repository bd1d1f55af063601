//! The objective as a Burn backend extension.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, ExtensionType, TensorMetadata, backend_extension};
use burn::tensor::{Shape, Tensor};
use mvfusion_kernels::splat::COLOUR_CHANNELS;

use super::cpu::{self, Arguments};
use super::error::{DYNAMIC_PLANES, STATIC_PLANES};
use super::{ObjectiveInputs, ObjectiveTerms};
use crate::host::HostBackend;
use crate::real::with_real;

/// The tensors of a view. Absent ones are placeholders of one value.
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct ObjectiveTensors<B: Backend> {
    pub dynamic: FloatTensor<B>,
    pub static_: FloatTensor<B>,
    pub exposure: FloatTensor<B>,
    pub photo: FloatTensor<B>,
    pub valid: FloatTensor<B>,
    pub moving: FloatTensor<B>,
    pub around: FloatTensor<B>,
}

/// Arguments that are not tensors.
#[derive(Clone, Debug)]
pub(crate) struct ObjectivePlan {
    pub terms: ObjectiveTerms,
    /// Height, width.
    pub size: [usize; 2],
    /// Whether there is an exposure.
    pub exposed: bool,
    /// Whether there is each mask: valid, moving, around.
    pub masked: [bool; 3],
}

/// The gradients of the loss.
#[derive(Clone, Debug)]
pub(crate) struct ObjectiveGradients<B: Backend> {
    pub dynamic: FloatTensor<B>,
    pub static_: FloatTensor<B>,
    pub exposure: FloatTensor<B>,
}

/// The objective.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait ObjectiveOps: Backend {
    /// `[2]`: the loss, and the mean squared error of the composed render, which has no gradient.
    fn objective(#[extension_type] tensors: ObjectiveTensors<Self>, plan: ObjectivePlan) -> FloatTensor<Self>;
}

/// The objective with its gradients; only on backends without autodiff.
pub(crate) trait ObjectiveAdjoint: ObjectiveOps {
    /// The values, and the gradients of the loss with respect to both renders and to the exposure.
    fn objective_with_gradients(
        tensors: ObjectiveTensors<Self>,
        plan: ObjectivePlan,
    ) -> (FloatTensor<Self>, ObjectiveGradients<Self>);

    /// The gradients times the first value of `v_values` `[2]`.
    fn objective_backward(
        gradients: ObjectiveGradients<Self>,
        v_values: FloatTensor<Self>,
    ) -> ObjectiveGradients<Self> {
        let v_loss = Self::float_slice(v_values, &[(0..1).into()]);
        let scaled = |gradient: FloatTensor<Self>| {
            let axes = gradient.shape().num_dims();
            let factor = Self::float_reshape(v_loss.clone(), Shape::from(vec![1; axes]));
            Self::float_mul(gradient, factor)
        };
        ObjectiveGradients {
            dynamic: scaled(gradients.dynamic),
            static_: scaled(gradients.static_),
            exposure: scaled(gradients.exposure),
        }
    }
}

impl<B: HostBackend> ObjectiveOps for B {
    fn objective(tensors: ObjectiveTensors<Self>, plan: ObjectivePlan) -> FloatTensor<Self> {
        on_host(tensors, &plan, false).0
    }
}

impl<B: HostBackend> ObjectiveAdjoint for B {
    fn objective_with_gradients(
        tensors: ObjectiveTensors<Self>,
        plan: ObjectivePlan,
    ) -> (FloatTensor<Self>, ObjectiveGradients<Self>) {
        let (values, gradients) = on_host(tensors, &plan, true);
        // Proof: they were asked for.
        (values, gradients.expect("the gradients"))
    }
}

fn on_host<B: HostBackend>(
    tensors: ObjectiveTensors<B>,
    plan: &ObjectivePlan,
    wanted: bool,
) -> (FloatTensor<B>, Option<ObjectiveGradients<B>>) {
    let [height, width] = plan.size;
    with_real!(tensors.dynamic.dtype(), T => {
        let (dynamic, static_) = (B::values::<T>(tensors.dynamic), B::values::<T>(tensors.static_));
        let (photo, exposure) = (B::values::<T>(tensors.photo), B::values::<T>(tensors.exposure));
        let masks = [tensors.valid, tensors.moving, tensors.around].map(B::values::<T>);
        let [valid, moving, around] = [0, 1, 2].map(|mask| plan.masked[mask].then_some(&masks[mask][..]));
        let arguments = Arguments {
            dynamic: &dynamic,
            static_: &static_,
            exposure: plan.exposed.then_some(&exposure[..]),
            photo: &photo,
            valid,
            moving,
            around,
            size: plan.size,
        };
        let outcome = cpu::objective(&arguments, &plan.terms, wanted);
        let gradients = outcome.gradients.map(|gradients| ObjectiveGradients {
            dynamic: B::tensor(gradients.dynamic, [2, DYNAMIC_PLANES, height, width]),
            static_: B::tensor(gradients.static_, [2, STATIC_PLANES, height, width]),
            exposure: B::tensor(gradients.exposure, [COLOUR_CHANNELS, COLOUR_CHANNELS + 1]),
        });
        (B::tensor(outcome.values.to_vec(), [2]), gradients)
    })
}

#[derive(Debug)]
struct ObjectiveBackward;

impl<B: ObjectiveAdjoint> Backward<B, 3> for ObjectiveBackward {
    type State = ObjectiveGradients<B>;

    fn backward(self, ops: Ops<Self::State, 3>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let v_values = gradients.consume::<B>(&ops.node);
        let ObjectiveGradients { dynamic, static_, exposure } = B::objective_backward(ops.state, v_values);
        for (node, gradient) in ops.parents.into_iter().zip([dynamic, static_, exposure]) {
            if let Some(node) = node {
                gradients.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: ObjectiveAdjoint, C: CheckpointStrategy> ObjectiveOps for Autodiff<B, C> {
    fn objective(tensors: ObjectiveTensors<Self>, plan: ObjectivePlan) -> FloatTensor<Self> {
        let nodes = [tensors.dynamic.node(), tensors.static_.node(), tensors.exposure.node()];
        let prepared = ObjectiveBackward.prepare::<C>(nodes).compute_bound().stateful();
        let tensors: ObjectiveTensors<B> = ObjectiveTensors {
            dynamic: tensors.dynamic.into_primitive(),
            static_: tensors.static_.into_primitive(),
            exposure: tensors.exposure.into_primitive(),
            photo: tensors.photo.into_primitive(),
            valid: tensors.valid.into_primitive(),
            moving: tensors.moving.into_primitive(),
            around: tensors.around.into_primitive(),
        };
        match prepared {
            OpsKind::Tracked(prepared) => {
                let (values, gradients) = B::objective_with_gradients(tensors, plan);
                prepared.finish(gradients, values)
            }
            OpsKind::UnTracked(prepared) => prepared.finish(B::objective(tensors, plan)),
        }
    }
}

pub(super) fn objective(inputs: ObjectiveInputs, terms: &ObjectiveTerms) -> Tensor<1> {
    let [_, _, height, width] = inputs.dynamic.dims();
    let masks = inputs.masks;
    let plan = ObjectivePlan {
        terms: terms.clone(),
        size: [height, width],
        exposed: inputs.exposure.is_some(),
        masked: [&masks.valid, &masks.moving, &masks.around].map(Option::is_some),
    };
    let (device, dtype) = (inputs.photo.device().inner(), inputs.photo.dtype());
    // No device binds an empty buffer.
    let none = || Tensor::<1>::zeros([1], (&device, dtype)).into_dispatch();
    let mask = |mask: Option<Tensor<3>>| mask.map_or_else(none, Tensor::into_dispatch);
    let tensors = ObjectiveTensors {
        dynamic: inputs.dynamic.into_dispatch(),
        static_: inputs.static_.into_dispatch(),
        exposure: inputs.exposure.map_or_else(none, Tensor::into_dispatch),
        photo: inputs.photo.into_dispatch(),
        valid: mask(masks.valid),
        moving: mask(masks.moving),
        around: mask(masks.around),
    };
    Tensor::from_dispatch(<Dispatch as ObjectiveOps>::objective(tensors, plan))
}
