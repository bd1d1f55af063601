//! Helpers for the tests of this crate: the compiled devices, random images, values of tensors.

use burn::tensor::{DType, Device, Tensor, TensorData};

use crate::random::Stream;

/// Runs a test body on every available device of this build.
pub fn for_each_device(body: impl Fn(Device)) {
    #[cfg(feature = "flex")]
    body(crate::device::flex());
    #[cfg(feature = "ndarray")]
    body(crate::device::ndarray());
    #[cfg(any(feature = "wgpu", feature = "cuda"))]
    for gpu in crate::device::gpus() {
        body(gpu.device.clone());
    }
}

/// An image `[1, 3, H, W]` of noise in `[0, 1]`.
pub fn picture(stream: &mut Stream, [height, width]: [usize; 2], device: &Device) -> Tensor<4> {
    let values: Vec<f32> = (0..3 * height * width).map(|_| stream.unit() as f32).collect();
    Tensor::from_data(TensorData::new(values, [1, 3, height, width]), device)
}

/// The values of a tensor, row-major.
pub fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data().convert_dtype(DType::F64).try_into_vec().expect("the conversion made them f64")
}
