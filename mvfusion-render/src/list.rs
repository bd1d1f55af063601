//! Lists of tensors as arguments and results of an op, and as the parents of its backward step.

use burn::backend::autodiff::ops::NodeGuard;
use burn::backend::tensor::FloatTensor;
use burn::backend::{
    Autodiff, Backend, BackendTensor, Dispatch, DispatchAutodiffContext, DispatchTensor, DispatchTensorKind,
    ExtensionType,
};
use burn::tensor::Tensor;

/// Any number of float tensors.
#[derive(Clone, Debug)]
pub(crate) struct Floats<B: Backend>(pub Vec<FloatTensor<B>>);

// Implemented by hand, because the derive recognises single tensors only.
impl<B: Backend> ExtensionType<B> for Floats<B> {
    type Target = Floats<Dispatch>;

    fn map_to_dispatch<F>(self, map_kind: F, autodiff: DispatchAutodiffContext) -> Self::Target
    where
        F: Fn(BackendTensor<B>) -> DispatchTensorKind,
    {
        let wrap = |tensor| DispatchTensor { kind: map_kind(BackendTensor::Float(tensor)), autodiff };
        Floats(self.0.into_iter().map(wrap).collect())
    }

    fn map_from_dispatch<F>(target: Self::Target, unwrap_kind: F) -> Self
    where
        F: Fn(DispatchTensor) -> BackendTensor<B>,
    {
        Self(target.0.into_iter().map(|tensor| unwrap_kind(tensor).float()).collect())
    }

    fn routing_tensor(target: &Self::Target) -> Option<&DispatchTensor> {
        target.0.first()
    }

    fn routing_float_tensor(target: &Self::Target) -> Option<&DispatchTensor> {
        target.0.first()
    }

    fn autodiff_context(target: &Self::Target) -> DispatchAutodiffContext {
        let contexts = target.0.iter().map(|tensor| tensor.autodiff);
        contexts.fold(DispatchAutodiffContext::Disabled, DispatchAutodiffContext::merge)
    }
}

impl Floats<Dispatch> {
    /// The primitives of tensors.
    pub fn of<const D: usize>(tensors: impl IntoIterator<Item = Tensor<D>>) -> Self {
        Self(tensors.into_iter().map(Tensor::into_dispatch).collect())
    }

    /// The tensors of primitives of rank `D`.
    pub fn into_tensors<const D: usize>(self) -> impl Iterator<Item = Tensor<D>> {
        self.0.into_iter().map(Tensor::from_dispatch)
    }
}

/// The nodes of at most `N` tensors. Burn's backward steps have a fixed number of parents, so the rest are nodes
/// without gradient.
///
/// # Panics
/// If there are more tensors.
pub(crate) fn parents<'a, B: Backend, const N: usize>(
    tensors: impl IntoIterator<Item = &'a FloatTensor<Autodiff<B>>>,
) -> [NodeGuard; N] {
    let mut tensors = tensors.into_iter().peekable();
    // Proof: every op here has at least one tensor.
    let first = tensors.peek().expect("an op has a tensor");
    let nobody = FloatTensor::<Autodiff<B>>::new(first.primitive().clone());
    let nodes = std::array::from_fn(|_| tensors.next().unwrap_or(&nobody).node());
    assert!(tensors.next().is_none(), "an op has at most {N} tensors");
    nodes
}
