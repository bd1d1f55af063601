//! How the CPU twins get at the numbers of a tensor: one trait, implemented by each CPU backend of Burn.

use std::ops::Deref;

use burn::backend::{Backend, tensor::{FloatTensor, IntTensor}};
use burn::tensor::Shape;

use crate::Real;

/// A backend whose tensors live in host memory, so that an op written on slices serves it.
pub(crate) trait HostBackend: Backend {
    /// Read access to the numbers of a tensor, row-major, without a copy where the tensor is contiguous.
    type Values<T: Real>: Deref<Target = [T]> + Send + Sync;

    /// Read access to the indices of an `i32` tensor.
    type Indices: Deref<Target = [i32]> + Send + Sync;

    /// The numbers of a tensor whose dtype is `T`'s.
    fn values<T: Real>(tensor: FloatTensor<Self>) -> Self::Values<T>;

    /// A tensor of `shape` from row-major numbers.
    fn tensor<T: Real>(values: Vec<T>, shape: impl Into<Shape>) -> FloatTensor<Self>;

    /// The numbers of a tensor to change; without a copy where nobody else holds them.
    fn values_mut<T: Real>(tensor: &mut FloatTensor<Self>) -> &mut [T];

    /// The indices of an integer tensor made by [`HostBackend::index_tensor`].
    fn indices(tensor: IntTensor<Self>) -> Self::Indices;

    /// An `i32` tensor of `shape`.
    fn index_tensor(indices: Vec<i32>, shape: impl Into<Shape>) -> IntTensor<Self>;
}
