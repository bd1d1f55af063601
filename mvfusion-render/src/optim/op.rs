//! Adam as a Burn backend extension: without autodiff, and in place if memory is not shared.

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, Dispatch, ExtensionType, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::{AdamMoments, AdamRule, cpu};
use crate::host::HostBackend;
use crate::real::with_real;

/// A parameter after a step, with its moments.
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct Stepped<B: Backend> {
    pub(crate) value: FloatTensor<B>,
    pub(crate) first: FloatTensor<B>,
    pub(crate) second: FloatTensor<B>,
}

/// One step of Adam.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub(crate) trait AdamOps: Backend {
    /// Performs step number `step`, counted from 1.
    fn adam_step(
        value: FloatTensor<Self>,
        gradient: FloatTensor<Self>,
        first: FloatTensor<Self>,
        second: FloatTensor<Self>,
        rule: AdamRule,
        step: usize,
    ) -> Stepped<Self>;
}

impl<B: HostBackend> AdamOps for B {
    fn adam_step(
        mut value: FloatTensor<Self>,
        gradient: FloatTensor<Self>,
        mut first: FloatTensor<Self>,
        mut second: FloatTensor<Self>,
        rule: AdamRule,
        step: usize,
    ) -> Stepped<Self> {
        with_real!(value.dtype(), T => {
            let state = cpu::State {
                value: B::values_mut::<T>(&mut value),
                first: B::values_mut::<T>(&mut first),
                second: B::values_mut::<T>(&mut second),
            };
            cpu::step(state, &B::values::<T>(gradient), &rule, step);
        });
        Stepped { value, first, second }
    }
}

pub(super) fn adam_step<const D: usize>(
    value: Tensor<D>,
    gradient: Tensor<D>,
    moments: AdamMoments<D>,
    rule: &AdamRule,
) -> (Tensor<D>, AdamMoments<D>) {
    let steps = moments.steps + 1;
    let (first, second) = (moments.first.into_dispatch(), moments.second.into_dispatch());
    let (value, gradient) = (value.into_dispatch(), gradient.into_dispatch());
    let stepped = <Dispatch as AdamOps>::adam_step(value, gradient, first, second, *rule, steps);
    let moments = AdamMoments {
        first: Tensor::from_dispatch(stepped.first),
        second: Tensor::from_dispatch(stepped.second),
        steps,
    };
    (Tensor::from_dispatch(stepped.value), moments)
}
