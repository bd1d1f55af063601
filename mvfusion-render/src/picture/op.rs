//! Unpacking as a Burn backend extension.

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, Dispatch, backend_extension};
use burn::tensor::{DType, Device, Int, Tensor, TensorData};

use super::unpacked;
use crate::host::HostBackend;

/// Bytes of a word.
const BYTES: usize = size_of::<i32>();

/// The op; not on autodiff backends, because nothing is learned about photos.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"))]
pub(crate) trait PictureOps: Backend {
    /// Planes `[1, C, H, W]` of this `shape`, in `[0, 1]`, from bytes `[H, W, C]`, four to a word, the first one lowest.
    fn unpack(words: IntTensor<Self>, shape: [usize; 4]) -> FloatTensor<Self>;
}

impl<B: HostBackend> PictureOps for B {
    fn unpack(words: IntTensor<Self>, shape: [usize; 4]) -> FloatTensor<Self> {
        let bytes: Vec<u8> = B::indices(words).iter().flat_map(|word| word.to_le_bytes()).collect();
        let count = shape.iter().product::<usize>();
        B::tensor(unpacked(&bytes[..count], shape[1]), shape)
    }
}

/// Sends the bytes to the device, and unpacks them there.
pub(super) fn unpack(bytes: &[u8], shape: [usize; 4], device: &Device) -> Tensor<4> {
    let (whole, rest) = bytes.as_chunks::<BYTES>();
    let mut last = [0; BYTES];
    last[..rest.len()].copy_from_slice(rest);
    let words: Vec<i32> = whole.iter().chain(std::iter::once(&last)).map(|bytes| i32::from_le_bytes(*bytes)).collect();
    let count = words.len();
    let words = Tensor::<1, Int>::from_data(TensorData::new(words, [count]), (device, DType::I32));
    Tensor::from_dispatch(<Dispatch as PictureOps>::unpack(words.into_dispatch(), shape))
}
