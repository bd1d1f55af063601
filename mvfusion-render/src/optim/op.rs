//! Adam as a Burn backend extension: without autodiff, and in place if memory is not shared.

use burn::backend::{Backend, Dispatch, ExtensionType, TensorMetadata, backend_extension};

use super::{AdamMoments, AdamRule, AdamStep, Stepped, cpu};
use crate::host::HostBackend;
use crate::list::Floats;
use crate::real::with_real;

/// The values and moments of all parameters.
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct AdamState<B: Backend> {
    #[extension_type]
    pub(crate) values: Floats<B>,
    #[extension_type]
    pub(crate) firsts: Floats<B>,
    #[extension_type]
    pub(crate) seconds: Floats<B>,
}

/// One step of Adam.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub(crate) trait AdamOps: Backend {
    /// Steps all parameters, each by its rule. The numbers of the steps are counted from 1.
    fn adam_steps(
        #[extension_type] state: AdamState<Self>,
        #[extension_type] gradients: Floats<Self>,
        rules: Vec<(AdamRule, usize)>,
    ) -> AdamState<Self>;
}

impl<B: HostBackend> AdamOps for B {
    fn adam_steps(
        mut state: AdamState<Self>,
        gradients: Floats<Self>,
        rules: Vec<(AdamRule, usize)>,
    ) -> AdamState<Self> {
        with_real!(state.values.0[0].dtype(), T => {
            let gradients: Vec<_> = gradients.0.into_iter().map(B::values::<T>).collect();
            let AdamState { values, firsts, seconds } = &mut state;
            let moments = firsts.0.iter_mut().zip(&mut seconds.0);
            let pieces = values.0.iter_mut().zip(&gradients).zip(moments).zip(rules);
            let pieces = pieces.map(|(((value, gradient), (first, second)), (rule, step))| cpu::Piece {
                value: B::values_mut::<T>(value),
                first: B::values_mut::<T>(first),
                second: B::values_mut::<T>(second),
                gradient,
                step: cpu::Step::new(&rule, step),
            });
            cpu::step(pieces.collect());
        });
        state
    }
}

/// Steps at least one parameter.
pub(super) fn adam_steps<const D: usize>(parameters: Vec<AdamStep<D>>) -> Vec<Stepped<D>> {
    let rules: Vec<_> = parameters.iter().map(|parameter| (parameter.rule, parameter.moments.steps + 1)).collect();
    let (mut values, mut gradients, mut firsts, mut seconds) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for AdamStep { value, gradient, moments, rule: _ } in parameters {
        values.push(value);
        gradients.push(gradient);
        firsts.push(moments.first);
        seconds.push(moments.second);
    }
    let state = AdamState { values: Floats::of(values), firsts: Floats::of(firsts), seconds: Floats::of(seconds) };
    let state = <Dispatch as AdamOps>::adam_steps(state, Floats::of(gradients), rules.clone());
    let moments = state.firsts.into_tensors().zip(state.seconds.into_tensors()).zip(rules);
    let moments = moments.map(|((first, second), (_, steps))| AdamMoments { first, second, steps });
    let stepped = state.values.into_tensors().zip(moments);
    stepped.map(|(value, moments)| Stepped { value, moments }).collect()
}
