//! The splat op's place in the autodiff graph.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::{Autodiff, Backend};

use crate::profile::{self, Part};

use super::op::{SplatKernels, SplatOps, SplatOutput, SplatPlan, SplatPrimitives, SplatSaved};

/// The op's step back.
#[derive(Debug)]
struct SplatBackward;

/// What the step back needs.
#[derive(Clone, Debug)]
struct SplatState<B: Backend> {
    inputs: SplatPrimitives<B>,
    saved: SplatSaved<B>,
    plan: SplatPlan,
    part: Option<Part>,
}

impl<B: SplatKernels> Backward<B, 8> for SplatBackward {
    type State = SplatState<B>;

    fn backward(self, ops: Ops<Self::State, 8>, grads: &mut Gradients, _: &mut Checkpointer) {
        let SplatState { inputs, saved, plan, part } = ops.state;
        let v_picture = grads.consume::<B>(&ops.node);
        let statistic = ops.parents[7].as_ref().map(|_| plan.settings.statistic);
        let gradients =
            profile::measure_backward(part, || B::splat_backward(inputs, saved, v_picture, plan, statistic));
        let in_order = [
            gradients.means,
            gradients.quaternions,
            gradients.log_scales,
            gradients.opacity_logits,
            gradients.sh,
            gradients.features,
            gradients.background,
            gradients.statistic,
        ];
        for (parent, gradient) in ops.parents.into_iter().zip(in_order) {
            if let Some(node) = parent {
                grads.register::<B>(node.id, gradient);
            }
        }
    }
}

impl<B: SplatKernels, C: CheckpointStrategy> SplatOps for Autodiff<B, C> {
    fn splat(inputs: SplatPrimitives<Self>, plan: SplatPlan) -> SplatOutput<Self> {
        let nodes = [
            inputs.means.node(),
            inputs.quaternions.node(),
            inputs.log_scales.node(),
            inputs.opacity_logits.node(),
            inputs.sh.node(),
            inputs.features.node(),
            inputs.background.node(),
            inputs.probe.node(),
        ];
        let preparation = SplatBackward.prepare::<C>(nodes).compute_bound().stateful();
        let inputs = SplatPrimitives::<B> {
            means: inputs.means.into_primitive(),
            quaternions: inputs.quaternions.into_primitive(),
            log_scales: inputs.log_scales.into_primitive(),
            opacity_logits: inputs.opacity_logits.into_primitive(),
            sh: inputs.sh.into_primitive(),
            features: inputs.features.into_primitive(),
            background: inputs.background.into_primitive(),
            probe: inputs.probe.into_primitive(),
        };
        match preparation {
            OpsKind::Tracked(preparation) => {
                let forward = B::splat_forward(inputs.clone(), plan);
                let state = SplatState { inputs, saved: forward.saved, plan, part: profile::current() };
                let SplatOutput { picture, radii, refused } = forward.output;
                SplatOutput { picture: preparation.finish(state, picture), radii, refused }
            }
            OpsKind::UnTracked(preparation) => {
                let SplatOutput { picture, radii, refused } = B::splat(inputs, plan);
                SplatOutput { picture: preparation.finish(picture), radii, refused }
            }
        }
    }
}
