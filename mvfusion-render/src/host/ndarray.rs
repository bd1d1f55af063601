//! Burn's `ndarray` backend as a [`HostBackend`].

use std::marker::PhantomData;
use std::ops::Deref;

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{NdArray, TensorMetadata};
use burn::tensor::{Element, Shape, TensorData};
use burn_ndarray::NdArrayTensor;
use bytemuck::Pod;

use super::HostBackend;
use crate::Real;

/// A tensor in standard layout, read as values of type `E`.
pub(crate) struct NdArrayValues<E>(NdArrayTensor, PhantomData<E>);

impl<T: Element + Pod> Deref for NdArrayValues<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.0 {
            NdArrayTensor::F32(storage) => same_type(storage.view().to_slice()),
            NdArrayTensor::F64(storage) => same_type(storage.view().to_slice()),
            NdArrayTensor::I32(storage) => same_type(storage.view().to_slice()),
            // Proof: `with_real` and the index helpers use only these three types.
            other => panic!("{:?} numbers are not read by CPU twins", other.dtype()),
        }
    }
}

impl HostBackend for NdArray {
    type Values<T: Real> = NdArrayValues<T>;
    type Indices = NdArrayValues<i32>;

    fn values<T: Real>(tensor: FloatTensor<Self>) -> NdArrayValues<T> {
        assert_eq!(tensor.dtype(), T::dtype(), "numbers are read in the tensor's own dtype");
        NdArrayValues(in_standard_layout(tensor), PhantomData)
    }

    fn tensor<T: Real>(values: Vec<T>, shape: impl Into<Shape>) -> FloatTensor<Self> {
        NdArrayTensor::from_data(TensorData::new(values, shape))
    }

    fn values_mut<T: Real>(tensor: &mut FloatTensor<Self>) -> &mut [T] {
        assert_eq!(tensor.dtype(), T::dtype(), "numbers are changed in the tensor's own dtype");
        // The empty tensor is a placeholder, so that no second handle makes the buffer count as shared.
        let held = std::mem::replace(tensor, Self::tensor::<T>(Vec::new(), [0]));
        *tensor = in_standard_layout(held);
        match tensor {
            NdArrayTensor::F32(storage) => same_type_mut(storage.ensure_owned().as_slice_mut()),
            NdArrayTensor::F64(storage) => same_type_mut(storage.ensure_owned().as_slice_mut()),
            // Proof: `with_real` uses only these two types.
            other => panic!("{:?} numbers are not changed by CPU twins", other.dtype()),
        }
    }

    fn indices(tensor: IntTensor<Self>) -> NdArrayValues<i32> {
        assert_eq!(tensor.dtype(), i32::dtype(), "indices are `i32`");
        NdArrayValues(in_standard_layout(tensor), PhantomData)
    }

    fn index_tensor(indices: Vec<i32>, shape: impl Into<Shape>) -> IntTensor<Self> {
        NdArrayTensor::from_data(TensorData::new(indices, shape))
    }
}

/// The tensor in row-major order, copied only if necessary.
fn in_standard_layout(tensor: NdArrayTensor) -> NdArrayTensor {
    // This is a macro because Burn does not export the type of a variant's storage.
    macro_rules! standard {
        ($($variant:ident),*) => {
            match tensor {
                $(NdArrayTensor::$variant(storage) if !storage.view().is_standard_layout() => {
                    storage.view().as_standard_layout().into_owned().into_shared().into()
                })*
                other => other,
            }
        };
    }
    standard!(F32, F64, I32)
}

/// The values of a tensor in standard layout, as the caller's name for the same type.
fn same_type<E: Pod, T: Pod>(values: Option<&[E]>) -> &[T] {
    // Proof: every tensor here went through `in_standard_layout`, and its dtype was compared with that of `T`.
    bytemuck::cast_slice(values.expect("the layout is standard"))
}

fn same_type_mut<E: Pod, T: Pod>(values: Option<&mut [E]>) -> &mut [T] {
    // Proof: as in `same_type`.
    bytemuck::cast_slice_mut(values.expect("the layout is standard"))
}

/// The device of this backend.
pub(crate) fn device() -> burn::tensor::Device {
    burn::tensor::Device::ndarray()
}
