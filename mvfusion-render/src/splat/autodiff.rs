//! The splat op in the autodiff graph.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::{Autodiff, Backend};

use crate::profile::{self, Part};

use super::op::{Prepared, SplatBatch, SplatKernels, SplatOps, SplatOutput, SplatPlan, SplatPrimitives, SplatSaved};
use super::tensors::{SplatTensors, TENSORS};

/// The op's backward step.
#[derive(Debug)]
struct SplatBackward;

/// The state of the backward step.
#[derive(Clone, Debug)]
struct SplatState<B: Backend> {
    inputs: SplatPrimitives<B>,
    saved: SplatSaved<B>,
    plan: SplatPlan,
    part: Option<Part>,
}

impl<B: SplatKernels> Backward<B, TENSORS> for SplatBackward {
    type State = SplatState<B>;

    fn backward(self, ops: Ops<Self::State, TENSORS>, grads: &mut Gradients, _: &mut Checkpointer) {
        let SplatState { inputs, saved, plan, part } = ops.state;
        let v_picture = grads.consume::<B>(&ops.node);
        let parents = SplatTensors::from_array(ops.parents);
        let statistic = parents.probe.as_ref().map(|_| plan.settings.statistic);
        let gradients =
            profile::measure_backward(part, || B::splat_backward(inputs, saved, v_picture, plan, statistic));
        for (parent, gradient) in parents.zip(gradients).into_array() {
            if let Some(node) = parent {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: SplatKernels, C: CheckpointStrategy> SplatOps for Autodiff<B, C> {
    fn prepare(inputs: SplatPrimitives<Self>, plan: SplatPlan, batch: SplatBatch) -> Prepared {
        B::prepare(inputs.map(|tensor| tensor.into_primitive()), plan, batch)
    }

    fn splat(inputs: SplatPrimitives<Self>, plan: SplatPlan, prepared: Prepared) -> SplatOutput<Self> {
        let nodes = inputs.each_ref().map(|tensor| tensor.node()).into_array();
        let preparation = SplatBackward.prepare::<C>(nodes).compute_bound().stateful();
        let inputs = inputs.map(|tensor| tensor.into_primitive());
        match preparation {
            OpsKind::Tracked(preparation) => {
                let forward = B::splat_forward(inputs.clone(), plan, prepared);
                let state = SplatState { inputs, saved: forward.saved, plan, part: profile::current() };
                let SplatOutput { picture, radii, refused } = forward.output;
                SplatOutput { picture: preparation.finish(state, picture), radii, refused }
            }
            OpsKind::UnTracked(preparation) => {
                let SplatOutput { picture, radii, refused } = B::splat(inputs, plan, prepared);
                SplatOutput { picture: preparation.finish(picture), radii, refused }
            }
        }
    }
}
