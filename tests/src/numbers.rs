//! Numbers on the host: arrays in double precision, and the way into and out of tensors.

use std::cell::Cell;

use burn::tensor::{DType, Device, Gradients, Tensor, TensorData};
use mvfusion_render::splat::SplatInputs;

thread_local! {
    /// Whether this thread's tensors have padded rows.
    static PADDED: Cell<bool> = const { Cell::new(false) };
}

/// NaNs behind each padded row: 256 bytes or more, because Burn copies a part whose rows begin at odd places.
const PADDING: usize = 64;

/// Row-major numbers with their shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Array {
    /// Length of each axis; empty for a single number.
    pub shape: Vec<usize>,
    /// The numbers, last axis fastest.
    pub values: Vec<f64>,
}

impl Array {
    /// An array of the given shape.
    ///
    /// # Panics
    /// If the shape does not hold as many numbers as there are.
    pub fn new(shape: impl Into<Vec<usize>>, values: Vec<f64>) -> Self {
        let shape = shape.into();
        assert_eq!(shape.iter().product::<usize>(), values.len(), "shape {shape:?}");
        Self { shape, values }
    }

    /// A list of numbers.
    pub fn list(values: Vec<f64>) -> Self {
        Self { shape: vec![values.len()], values }
    }

    /// The numbers of a tensor with its shape.
    pub fn of<const D: usize>(tensor: Tensor<D>) -> Self {
        Self::new(tensor.dims(), numbers(tensor))
    }

    /// A matrix with its axes exchanged.
    ///
    /// # Panics
    /// If it has not two axes.
    pub fn transposed(&self) -> Self {
        let [rows, columns] = self.shape[..] else { panic!("{:?} is no matrix", self.shape) };
        let values = (0..columns * rows).map(|i| self.values[i % rows * columns + i / rows]).collect();
        Self::new([columns, rows], values)
    }

    /// The entries `begin..end` of the second axis.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn columns(&self, begin: usize, end: usize) -> Self {
        let inner: usize = self.shape[2..].iter().product();
        let row = self.shape[1] * inner;
        let values = self.values.chunks(row).flat_map(|row| row[begin * inner..end * inner].to_vec()).collect();
        let mut shape = self.shape.clone();
        shape[1] = end - begin;
        Self::new(shape, values)
    }

    /// The entry `index` of the first axis.
    ///
    /// # Panics
    /// If there is none.
    pub fn row(&self, index: usize) -> Self {
        let inner: usize = self.shape[1..].iter().product();
        Self::new(&self.shape[1..], self.values[index * inner..(index + 1) * inner].to_vec())
    }

    /// The same numbers in another shape.
    ///
    /// # Panics
    /// If that has another number of entries.
    pub fn reshaped(&self, shape: impl Into<Vec<usize>>) -> Self {
        Self::new(shape, self.values.clone())
    }

    /// The numbers after a function of each.
    pub fn map(&self, function: impl Fn(f64) -> f64) -> Self {
        Self { shape: self.shape.clone(), values: self.values.iter().map(|&v| function(v)).collect() }
    }

    /// Zeros in this shape.
    pub fn zeros_like(&self) -> Self {
        self.map(|_| 0.0)
    }

    /// The largest magnitude.
    pub fn largest(&self) -> f64 {
        self.values.iter().fold(0.0, |most, v| v.abs().max(most))
    }
}

/// A tensor of the given numbers.
///
/// # Panics
/// If the numbers do not fill the shape.
pub fn tensor<const D: usize>(values: &[f64], shape: [usize; D], device: &Device, dtype: DType) -> Tensor<D> {
    if PADDED.get() && D > 1 && shape[D - 1] > 0 {
        return padded(values, shape, device, dtype);
    }
    let data = TensorData::new(values.to_vec(), shape).convert_dtype(dtype);
    Tensor::from_data(data, (device, dtype))
}

/// While `body` runs, [`tensor`] makes tensors whose rows are part of longer ones, as some runtimes lay them out.
pub fn with_padded_rows<T>(body: impl FnOnce() -> T) -> T {
    /// Resets the switch, after a panic as well.
    struct Reset;
    impl Drop for Reset {
        fn drop(&mut self) {
            PADDED.set(false);
        }
    }
    let _reset = Reset;
    PADDED.set(true);
    body()
}

fn padded<const D: usize>(values: &[f64], shape: [usize; D], device: &Device, dtype: DType) -> Tensor<D> {
    let columns = shape[D - 1];
    let mut wide = shape;
    wide[D - 1] = columns + PADDING;
    let rows = values.chunks(columns).flat_map(|row| row.iter().copied().chain([f64::NAN; PADDING]));
    let data = TensorData::new(rows.collect::<Vec<_>>(), wide).convert_dtype(dtype);
    Tensor::from_data(data, (device, dtype)).narrow(D - 1, 0, columns)
}

/// The numbers of a tensor, row-major, in double precision.
///
/// # Panics
/// If the device does not hand them back.
pub fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    // Proof: only tests call this, and a test whose device fails must fail.
    tensor.inner().try_into_vec_as::<f64>().expect("the device hands its numbers back")
}

/// The gradients of all arguments of the splat op, by name.
pub fn splat_gradients(inputs: &SplatInputs, gradients: &Gradients) -> Vec<(&'static str, Array)> {
    let mut all = vec![
        ("means", gradient(&inputs.means, gradients)),
        ("quaternions", gradient(&inputs.quaternions, gradients)),
        ("log_scales", gradient(&inputs.log_scales, gradients)),
        ("opacity_logits", gradient(&inputs.opacity_logits, gradients)),
        ("sh", gradient(&inputs.sh, gradients)),
        ("background", gradient(&inputs.background, gradients)),
    ];
    all.extend(inputs.features.as_ref().map(|features| ("features", gradient(features, gradients))));
    all
}

/// The gradient of a leaf; zeros where the loss does not depend on it.
pub fn gradient<const D: usize>(leaf: &Tensor<D>, gradients: &Gradients) -> Array {
    match leaf.grad(gradients) {
        Some(gradient) => Array::of(gradient),
        None => Array::new(leaf.dims(), vec![0.0; leaf.dims().iter().product()]),
    }
}
