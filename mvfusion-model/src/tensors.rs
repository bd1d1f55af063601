//! Small helpers for Burn's tensors.

use std::pin::Pin;
use std::task::{Context, Poll, Waker};

use burn::tensor::{Element, Int, Tensor, TensorData, read_sync};
use mvfusion_render::device::is_gpu;

use crate::ModelError;

/// A `[1, 1]` constant with device and dtype of `like`, without autodiff.
pub fn scalar_like(like: &Tensor<2>, value: f64) -> Tensor<2> {
    from_data_like(TensorData::new(vec![value], [1, 1]), like)
}

/// A `[rows, columns]` constant with device and dtype of `like`, without autodiff. Each part has its number of rows and
/// the values of all of them. A single part has one row, which stands for all.
pub fn rows_of_parts<const L: usize>(parts: &[(usize, Vec<f64>)], like: &Tensor<L>) -> Tensor<2> {
    let values: Vec<f64> = match parts {
        [(_, values)] => values.clone(),
        _ => parts.iter().flat_map(|(rows, values)| values.repeat(*rows)).collect(),
    };
    let columns = parts.first().map_or(1, |(_, values)| values.len());
    let shape = [values.len() / columns.max(1), columns];
    from_data_like(TensorData::new(values, shape), like)
}

/// A range of rows; no copy of all of them.
pub fn some_rows(matrix: &Tensor<2>, first: usize, length: usize) -> Tensor<2> {
    match (first, matrix.dims()[0] == length) {
        (0, true) => matrix.clone(),
        _ => matrix.clone().narrow(0, first, length),
    }
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

/// A tensor of one value on its way to the host.
pub enum Reading {
    /// It is there.
    Done(Result<f32, ModelError>),
    /// The device has not computed it yet.
    Pending(Pin<Box<dyn Future<Output = Result<f32, ModelError>>>>),
}

impl Reading {
    /// Starts to read. The device does not wait for it, and what is launched later does not delay it. CUDA's reading
    /// waits here already.
    pub fn start(tensor: Tensor<1>) -> Self {
        let mut reading = Box::pin(async move {
            tensor.try_into_scalar_async::<f32>().await.map_err(|error| ModelError::Device(error.to_string()))
        });
        // The first poll sends the request. Nobody needs to be woken, because `wait` polls until the answer is there.
        match reading.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(value) => Self::Done(value),
            Poll::Pending => Self::Pending(reading),
        }
    }

    /// The value. Waits for the device.
    ///
    /// # Errors
    /// If the device fails to return it.
    pub fn wait(self) -> Result<f32, ModelError> {
        match self {
            Self::Done(value) => value,
            Self::Pending(reading) => read_sync(reading),
        }
    }
}
