//! Access of the CPU twins to the values of a tensor: a trait that each CPU backend of Burn implements.
//!
//! An op is written once for all of them, as `impl<B: HostBackend> SomeOps for B`. This does not overlap with the op's
//! implementations for `Autodiff<B, C>` and `Dispatch`, because the trait is local and they never implement it.

use std::ops::Deref;

use burn::backend::Backend;
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::tensor::Shape;

use crate::Real;

#[cfg(feature = "flex")]
mod flex;
#[cfg(feature = "ndarray")]
pub(crate) mod ndarray;

/// A backend whose tensors are in host memory, so that ops on slices work for it.
pub(crate) trait HostBackend: Backend {
    /// Read access to the values of a tensor, row-major, without a copy if the tensor is contiguous.
    type Values<T: Real>: Deref<Target = [T]> + Send + Sync;

    /// Read access to the indices of an `i32` tensor.
    type Indices: Deref<Target = [i32]> + Send + Sync;

    /// The values of a tensor with the dtype of `T`. Panics for another dtype.
    fn values<T: Real>(tensor: FloatTensor<Self>) -> Self::Values<T>;

    /// A tensor of `shape` from row-major values, without a copy.
    fn tensor<T: Real>(values: Vec<T>, shape: impl Into<Shape>) -> FloatTensor<Self>;

    /// Mutable access to the values of a tensor; without a copy if the buffer is not shared.
    fn values_mut<T: Real>(tensor: &mut FloatTensor<Self>) -> &mut [T];

    /// The indices of an integer tensor from [`HostBackend::index_tensor`].
    fn indices(tensor: IntTensor<Self>) -> Self::Indices;

    /// An `i32` tensor of `shape`.
    fn index_tensor(indices: Vec<i32>, shape: impl Into<Shape>) -> IntTensor<Self>;
}

#[cfg(test)]
mod tests {
    use burn::backend::TensorMetadata;

    use super::*;

    fn numbers_go_in_and_come_out<B: HostBackend>() {
        let tensor = B::tensor(vec![1.0f64, 2.0, 3.0, 4.0, 5.0, 6.0], [2, 3]);
        assert_eq!(tensor.shape(), Shape::from([2, 3]));
        assert_eq!(tensor.dtype(), burn::tensor::DType::F64);
        assert_eq!(&B::values::<f64>(tensor.clone())[..], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let turned = B::float_swap_dims(tensor, 0, 1);
        assert_eq!(&B::values::<f64>(turned)[..], [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
        let indices = B::index_tensor(vec![3, -1], [2]);
        assert_eq!(&B::indices(indices)[..], [3, -1]);
    }

    fn a_change_does_not_reach_another_holder<B: HostBackend>() {
        let mut tensor = B::tensor(vec![1.0f32, 2.0], [2]);
        let other = tensor.clone();
        B::values_mut::<f32>(&mut tensor)[0] = 7.0;
        assert_eq!(&B::values::<f32>(tensor)[..], [7.0, 2.0]);
        assert_eq!(&B::values::<f32>(other)[..], [1.0, 2.0]);
    }

    fn a_tensor_held_alone_is_changed_in_place<B: HostBackend>() {
        let mut tensor = B::tensor(vec![1.0f32; 64], [8, 8]);
        let before = B::values_mut::<f32>(&mut tensor).as_ptr();
        assert_eq!(B::values_mut::<f32>(&mut tensor).as_ptr(), before);
        assert_eq!(B::values::<f32>(tensor).as_ptr(), before);
    }

    #[cfg(feature = "flex")]
    #[test]
    fn flex_hands_out_its_numbers() {
        numbers_go_in_and_come_out::<burn::backend::Flex>();
        a_change_does_not_reach_another_holder::<burn::backend::Flex>();
        a_tensor_held_alone_is_changed_in_place::<burn::backend::Flex>();
    }

    #[cfg(feature = "ndarray")]
    #[test]
    fn ndarray_hands_out_its_numbers() {
        numbers_go_in_and_come_out::<burn::backend::NdArray>();
        a_change_does_not_reach_another_holder::<burn::backend::NdArray>();
        a_tensor_held_alone_is_changed_in_place::<burn::backend::NdArray>();
    }
}
