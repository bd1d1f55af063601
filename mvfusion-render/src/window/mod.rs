//! Gaussian windows over images: the blur, and the similarity maps based on it.

pub(crate) mod cpu;
pub(crate) mod op;
pub(crate) mod similarity;
mod ssim;

use burn::tensor::Tensor;

pub use ssim::{ssim_map, structure_map};

/// The weights of a separable, symmetric window; the same along both axes of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    weights: Vec<f32>,
}

impl Window {
    /// A Gaussian with standard deviation `sigma` in pixels, sampled at `size` pixels around its middle and normalised
    /// to sum 1 (METHOD §4.4: SSIM uses 11 pixels and sigma 1.5). An even `size` counts as the next odd one, because a
    /// window has a middle pixel.
    ///
    /// Weights are rounded to multiples of 2^-24, and the middle one is the rest up to 1. Their sums are exact in `f32`
    /// in any order, and a variance does not depend on an offset of the image.
    ///
    /// # Panics
    /// If the square of `sigma` is not above 0.
    pub fn gaussian(size: usize, sigma: f64) -> Self {
        /// Steps of an `f32` between 0 and 1.
        const STEPS: f64 = (1u32 << 24) as f64;
        assert!(sigma * sigma > 0.0, "a window has a standard deviation above 0");
        let radius = size / 2;
        let bell = |i: usize| {
            let distance = i as f64 - radius as f64;
            (-distance * distance / (2.0 * sigma * sigma)).exp()
        };
        let sum: f64 = (0..=2 * radius).map(bell).sum();
        let mut weights: Vec<f64> = (0..=2 * radius).map(|i| (bell(i) / sum * STEPS).round() / STEPS).collect();
        weights[radius] = 1.0 - 2.0 * weights[..radius].iter().sum::<f64>();
        Self { weights: weights.into_iter().map(|weight| weight as f32).collect() }
    }

    /// The weights along one axis: symmetric, and odd in number.
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }
}

/// Convolves each channel of `images` `[B, C, H, W]` with `window` along both axes, with zeros outside the image. The
/// size does not change. The op is linear and self-adjoint, so its gradient is the same blur of the cotangent.
///
/// # Panics
/// If the dtype is not f32, or f64 on a CPU, or if a GPU has no buffer that is large enough.
pub fn blur(images: Tensor<4>, window: &Window) -> Tensor<4> {
    op::blur(images, window)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, numbers, random};

    /// A few rounding errors in f64 and in f32, on numbers of size one.
    const EXACT: f64 = 1e-12;
    const SINGLE: f64 = 2e-6;

    fn tensor(values: &[f64], shape: [usize; 4], device: &Device, dtype: DType) -> Tensor<4> {
        Tensor::from_data(TensorData::new(values.to_vec(), shape), (device, dtype))
    }

    /// The definition: every pixel sums over all pixels.
    fn slow_blur(image: &[f64], [height, width]: [usize; 2], window: &Window) -> Vec<f64> {
        let radius = window.weights.len() / 2;
        let weight = |a: usize, b: usize| match (b + radius).checked_sub(a) {
            Some(i) if i < window.weights.len() => f64::from(window.weights[i]),
            _ => 0.0,
        };
        let mut out = vec![0.0; height * width];
        for (i, value) in out.iter_mut().enumerate() {
            for (j, pixel) in image.iter().enumerate() {
                *value += pixel * weight(i / width, j / width) * weight(i % width, j % width);
            }
        }
        out
    }

    #[test]
    fn a_window_sums_to_one_and_is_symmetric() {
        let window = Window::gaussian(11, 1.5);
        let weights = window.weights();
        assert_eq!(weights.len(), 11);
        assert_eq!((weights.iter().sum::<f32>(), weights.iter().rev().sum::<f32>()), (1.0, 1.0));
        assert!((0..11).all(|i| weights[i] == weights[10 - i]));
    }

    #[test]
    fn blur_is_the_definition_for_any_shape() {
        for_each_device(|device| {
            for (shape, size) in
                [([1, 1, 1, 1], 11), ([2, 3, 5, 7], 11), ([1, 2, 40, 3], 5), ([1, 1, 9, 83], 11), ([1, 1, 3, 64], 1)]
            {
                let [batch, channels, height, width] = shape;
                let window = Window::gaussian(size, 1.5);
                let values = random(1, batch * channels * height * width);
                let wanted: Vec<f64> =
                    values.chunks(height * width).flat_map(|p| slow_blur(p, [height, width], &window)).collect();
                for (dtype, tolerance) in [(DType::F64, EXACT), (DType::F32, SINGLE)] {
                    let found = numbers(blur(tensor(&values, shape, &device, dtype), &window));
                    assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < tolerance), "{shape:?} {dtype:?}");
                }
            }
        });
    }

    #[test]
    fn the_gradient_of_a_blur_is_the_blurred_cotangent() {
        for_each_device(|device| {
            let shape = [1, 2, 12, 20];
            let window = Window::gaussian(11, 1.5);
            let device = device.autodiff();
            let image = tensor(&random(1, 480), shape, &device, DType::F64).require_grad();
            let cotangent = tensor(&random(2, 480), shape, &device, DType::F64);
            let gradients = (blur(image.clone(), &window) * cotangent.clone()).sum().backward();
            let found = numbers(image.grad(&gradients).expect("the image is tracked"));
            assert_eq!(found, numbers(blur(cotangent, &window).inner()));
        });
    }
}
