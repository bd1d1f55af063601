//! Burn's pure-Rust CPU backend as a [`HostBackend`].

use std::marker::PhantomData;
use std::ops::Deref;

use burn::backend::Flex;
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::tensor::{Shape, TensorData};
use burn_flex::FlexTensor;

use super::HostBackend;
use crate::Real;

/// A contiguous tensor that fills its buffer, read as values of type `E`.
pub(crate) struct FlexValues<E>(FlexTensor, PhantomData<E>);

impl<T: Real> Deref for FlexValues<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        self.0.storage()
    }
}

/// The same for indices, which are not a [`Real`].
pub(crate) struct FlexIndices(FlexTensor);

impl Deref for FlexIndices {
    type Target = [i32];

    fn deref(&self) -> &[i32] {
        self.0.storage()
    }
}

impl HostBackend for Flex {
    type Values<T: Real> = FlexValues<T>;
    type Indices = FlexIndices;

    fn values<T: Real>(tensor: FloatTensor<Self>) -> FlexValues<T> {
        FlexValues(tensor.to_contiguous(), PhantomData)
    }

    fn tensor<T: Real>(values: Vec<T>, shape: impl Into<Shape>) -> FloatTensor<Self> {
        FlexTensor::from_data(TensorData::new(values, shape))
    }

    fn values_mut<T: Real>(tensor: &mut FloatTensor<Self>) -> &mut [T] {
        // The assignment drops the old handle, so that an unshared buffer counts as unique.
        let contiguous = tensor.to_contiguous();
        *tensor = contiguous;
        tensor.storage_mut()
    }

    fn indices(tensor: IntTensor<Self>) -> FlexIndices {
        FlexIndices(tensor.to_contiguous())
    }

    fn index_tensor(indices: Vec<i32>, shape: impl Into<Shape>) -> IntTensor<Self> {
        FlexTensor::from_data(TensorData::new(indices, shape))
    }
}
