//! SSIM and its structure term, pixel by pixel.

use burn::tensor::Tensor;

use super::{Window, op, similarity::Similarity};

/// SSIM of `a` and `b`, both `[B, C, H, W]` with the same dtype, at each pixel, `[B, C, H, W]`. It uses windowed means,
/// variances and covariance with zeros outside the images, C1 = 0.01² and C2 = 0.03² (METHOD §4.4; the window there is
/// `Window::gaussian(11, 1.5)`). Gradients reach both images.
///
/// # Panics
/// If the shapes differ, or the dtype is not f32, or f64 on a CPU. On a GPU also if the window has more than 193
/// pixels, or no buffer holds four maps.
pub fn ssim_map(a: Tensor<4>, b: Tensor<4>, window: &Window) -> Tensor<4> {
    op::similarity(a, b, window, Similarity::Ssim)
}

/// The structure similarity K of `a` and `b`, both `[B, C, H, W]` with the same dtype, at each pixel, `[B, C, H, W]`:
/// `clip((s_ab + C3) / sqrt(s_a² + s_b² + C3), 0, 0.98)` with C3 = 0.03²/2 (METHOD §4.4 item 4; the window there is
/// `Window::gaussian(5, 1.5)`). Gradients reach both images, and are zero where the value is clipped.
///
/// # Panics
/// If the shapes differ, or the dtype is not f32, or f64 on a CPU. On a GPU also if the window has more than 193
/// pixels, or no buffer holds four maps.
pub fn structure_map(a: Tensor<4>, b: Tensor<4>, window: &Window) -> Tensor<4> {
    op::similarity(a, b, window, Similarity::Structure)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::super::blur;
    use super::*;
    use crate::test_support::{for_each_device, numbers, random};

    const SHAPE: [usize; 4] = [2, 3, 13, 21];

    /// In f64, two orders of rounding differ by little; the derivatives divide by variances near 1e-3.
    const EXACT: f64 = 1e-9;

    /// f32 loses digits in the gradients, where large numbers of both signs cancel.
    const SINGLE: f64 = 2e-4;

    /// Tolerance of maps in f32.
    const FLAT: f64 = 2e-6;

    type Map = fn(Tensor<4>, Tensor<4>, &Window) -> Tensor<4>;

    /// SSIM with tensor operations.
    fn slow_ssim(a: Tensor<4>, b: Tensor<4>, window: &Window) -> Tensor<4> {
        let [mean_a, mean_b, variance_a, variance_b, covariance] = moments(a, b, window);
        let luminance = mean_a.clone() * mean_b.clone() * 2.0 + 1e-4;
        let contrast = covariance * 2.0 + 9e-4;
        luminance * contrast / ((mean_a.square() + mean_b.square() + 1e-4) * (variance_a + variance_b + 9e-4))
    }

    /// The structure term with tensor operations.
    fn slow_structure(a: Tensor<4>, b: Tensor<4>, window: &Window) -> Tensor<4> {
        let [_, _, variance_a, variance_b, covariance] = moments(a, b, window);
        ((covariance + 4.5e-4) / (variance_a + variance_b + 4.5e-4).sqrt()).clamp(0.0, 0.98)
    }

    fn moments(a: Tensor<4>, b: Tensor<4>, window: &Window) -> [Tensor<4>; 5] {
        let (mean_a, mean_b) = (blur(a.clone(), window), blur(b.clone(), window));
        let variance_a = blur(a.clone().square(), window) - mean_a.clone().square();
        let variance_b = blur(b.clone().square(), window) - mean_b.clone().square();
        let covariance = blur(a * b, window) - mean_a.clone() * mean_b.clone();
        [mean_a, mean_b, variance_a, variance_b, covariance]
    }

    /// The map, and the adjoints of both images.
    fn run(map: Map, pictures: [&[f64]; 2], window: &Window, device: &Device, dtype: DType) -> [Vec<f64>; 3] {
        let device = &device.clone().autodiff();
        let tensor = |values: &[f64]| Tensor::<4>::from_data(TensorData::new(values.to_vec(), SHAPE), (device, dtype));
        let [a, b] = pictures.map(|picture| tensor(picture).require_grad());
        let found = map(a.clone(), b.clone(), window);
        let gradients = (found.clone() * tensor(&random(3, SHAPE.iter().product()))).sum().backward();
        let [a, b] = [a, b].map(|picture| numbers(picture.grad(&gradients).expect("tracked")));
        [numbers(found.inner()), a, b]
    }

    fn assert_fused_is_slow(fused: Map, slow: Map, window: &Window) {
        let count = SHAPE.iter().product();
        let (a, noise) = (random(1, count), random(2, count));
        let b: Vec<f64> = a.iter().zip(&noise).map(|(a, noise)| 0.7 * a + 0.3 * noise).collect();
        for_each_device(|device| {
            let wanted = run(slow, [&a, &b], window, &device, DType::F64);
            for (dtype, tolerance) in [(DType::F64, EXACT), (DType::F32, SINGLE)] {
                let found = run(fused, [&a, &b], window, &device, dtype);
                for (part, (found, wanted)) in found.iter().zip(&wanted).enumerate() {
                    let largest = wanted.iter().fold(1.0f64, |largest, x| largest.max(x.abs()));
                    let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(worst < tolerance * largest, "part {part} in {dtype:?}: off by {worst} of {largest}");
                }
            }
        });
    }

    #[test]
    fn the_fused_ssim_is_the_one_of_tensor_operations() {
        assert_fused_is_slow(ssim_map, slow_ssim, &Window::gaussian(11, 1.5));
    }

    #[test]
    fn the_fused_structure_is_the_one_of_tensor_operations() {
        assert_fused_is_slow(structure_map, slow_structure, &Window::gaussian(5, 1.5));
    }

    #[test]
    fn a_picture_is_like_itself() {
        let a = random(1, SHAPE.iter().product());
        for_each_device(|device| {
            let [map, ..] = run(ssim_map, [&a, &a], &Window::gaussian(11, 1.5), &device, DType::F64);
            assert!(map.iter().all(|value| (value - 1.0).abs() < EXACT));
        });
    }

    #[test]
    fn bright_and_flat_pictures_lose_no_digits() {
        let noisy = |seed| -> Vec<f64> {
            random(seed, SHAPE.iter().product()).into_iter().map(|noise| 0.95 + 0.004 * noise).collect()
        };
        let (a, b) = (noisy(1), noisy(2));
        for_each_device(|device| {
            for (map, size) in [(ssim_map as Map, 11), (structure_map as Map, 5)] {
                let window = Window::gaussian(size, 1.5);
                let [wanted, found] = [DType::F64, DType::F32].map(|dtype| {
                    let [map, ..] = run(map, [&a, &b], &window, &device, dtype);
                    map
                });
                let worst = found.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(worst < FLAT, "a window of {size} is off by {worst}");
            }
        });
    }

    #[test]
    fn flat_pictures_give_numbers_whatever_their_size() {
        for_each_device(|device| {
            for level in [0.0, 1.0, 0.1, 1e4] {
                let flat = vec![level; SHAPE.iter().product()];
                for (map, size) in [(ssim_map as Map, 11), (structure_map as Map, 5)] {
                    let parts = run(map, [&flat, &flat], &Window::gaussian(size, 1.5), &device, DType::F32);
                    assert!(parts.iter().flatten().all(|number| number.is_finite()), "at {level}");
                }
            }
        });
    }
}
