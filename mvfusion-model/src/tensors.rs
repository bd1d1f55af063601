//! Small helpers for Burn's tensors.

use burn::tensor::{Element, Int, Tensor, TensorData};
use mvfusion_render::device::is_gpu;

use crate::ModelError;

/// A `[1, 1]` constant with device and dtype of `like`, without autodiff.
pub fn scalar_like(like: &Tensor<2>, value: f64) -> Tensor<2> {
    from_data_like(TensorData::new(vec![value], [1, 1]), like)
}

/// Data as a tensor with device and dtype of `like`, without autodiff.
pub fn from_data_like<const D: usize, const L: usize>(data: TensorData, like: &Tensor<L>) -> Tensor<D> {
    let dtype = like.dtype();
    Tensor::from_data(data.convert_dtype(dtype), (&like.device().inner(), dtype))
}

/// Row indices as an index tensor on the device of `like`.
pub fn rows_like<const L: usize>(rows: &[usize], like: &Tensor<L>) -> Tensor<1, Int> {
    let rows: Vec<i32> = rows.iter().map(|&row| row as i32).collect();
    let count = rows.len();
    Tensor::from_data(TensorData::new(rows, [count]), &like.device().inner())
}

/// Rows of a GPU's chunk for one of a CPU, whose memory is smaller and which gains nothing from longer launches.
const GPU_CHUNK: usize = 8;

/// The rows of a chunk of `chunk` rows on a CPU, on the device of `like`.
pub fn rows_at_once<const D: usize>(chunk: usize, like: &Tensor<D>) -> usize {
    chunk.max(1) * if is_gpu(&like.device().inner()) { GPU_CHUNK } else { 1 }
}

/// The values of a tensor, row-major. Waits for the device.
///
/// # Errors
/// If the device fails to return values.
pub fn read<const D: usize, E: Element>(tensor: Tensor<D>) -> Result<Vec<E>, ModelError> {
    tensor.try_into_vec_as::<E>().map_err(|error| ModelError::Device(error.to_string()))
}
