//! Picture metrics (FORMATS: PSNR after an 8-bit round trip, SSIM as 3DGS computes it).

use burn::tensor::Tensor;
use image::{GrayImage, RgbImage};
use mvfusion_render::window::{self, Window};

use crate::ModelError;
use crate::tensors;

/// A peak signal-to-noise ratio in dB; `None` for equal pictures, whose ratio is infinite, and for empty regions.
pub type Psnr = Option<f64>;

/// Ratio for values in `[0, 1]` from the mean squared error.
fn decibels(squared_error: f64) -> Psnr {
    (squared_error > 0.0).then(|| -10.0 * squared_error.log10())
}

/// PSNR of two 8-bit pictures of the same size, over all pixels and channels.
pub fn psnr(picture: &RgbImage, reference: &RgbImage) -> Psnr {
    let errors = picture.as_raw().iter().zip(reference.as_raw()).map(|(&a, &b)| squared(a, b));
    decibels(errors.sum::<f64>() / picture.as_raw().len().max(1) as f64)
}

/// PSNR over the pixels where the mask is white (128 or more).
pub fn masked_psnr(picture: &RgbImage, reference: &RgbImage, mask: &GrayImage) -> Psnr {
    let mut sum = 0.0;
    let mut count = 0usize;
    for ((a, b), m) in picture.pixels().zip(reference.pixels()).zip(mask.pixels()) {
        if m.0[0] >= 128 {
            sum += a.0.iter().zip(b.0).map(|(&a, b)| squared(a, b)).sum::<f64>();
            count += 3;
        }
    }
    if count == 0 { None } else { decibels(sum / count as f64) }
}

fn squared(a: u8, b: u8) -> f64 {
    let difference = (f64::from(a) - f64::from(b)) / 255.0;
    difference * difference
}

/// SSIM of two pictures `[1, 3, H, W]` in `[0, 1]`: 11-pixel Gaussian window of sigma 1.5, zero padding, mean of the map.
///
/// # Errors
/// If the device cannot hand its numbers back.
pub fn ssim(picture: Tensor<4>, reference: Tensor<4>) -> Result<f64, ModelError> {
    let map: Vec<f64> = tensors::read(window::ssim_map(picture, reference, &Window::gaussian(11, 1.5)))?;
    Ok(map.iter().sum::<f64>() / map.len().max(1) as f64)
}

/// A picture `[1, 3, H, W]` (or one channel, repeated) as 8-bit RGB: clamped, rounded.
///
/// # Errors
/// If the device cannot hand its numbers back.
pub fn quantise(picture: Tensor<4>) -> Result<RgbImage, ModelError> {
    let [_, channels, height, width] = picture.dims();
    let values: Vec<f32> = tensors::read(picture)?;
    let plane = width * height;
    Ok(RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let pixel = y as usize * width + x as usize;
        image::Rgb(std::array::from_fn(|channel| {
            let value = values[channel.min(channels - 1) * plane + pixel];
            (value.clamp(0.0, 1.0) * 255.0).round() as u8
        }))
    }))
}

/// Overlap of predicted and true masks, pooled over views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MaskOverlap {
    both: usize,
    either: usize,
}

impl MaskOverlap {
    /// Takes in a view: a predicted mask in 0..255, white from 128 on as in the true one.
    pub fn add(&mut self, predicted: &RgbImage, truth: &GrayImage) {
        for (p, t) in predicted.pixels().zip(truth.pixels()) {
            let (p, t) = (p.0[0] >= 128, t.0[0] >= 128);
            self.both += usize::from(p && t);
            self.either += usize::from(p || t);
        }
    }

    /// Intersection over union; `None` if both were black everywhere.
    pub fn ratio(&self) -> Option<f64> {
        (self.either > 0).then(|| self.both as f64 / self.either as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(level: u8) -> RgbImage {
        RgbImage::from_pixel(4, 4, image::Rgb([level; 3]))
    }

    #[test]
    fn psnr_of_a_tenth_is_twenty_decibels() {
        let ratio = psnr(&grey(0), &grey(51)).expect("the pictures differ");
        assert!((ratio - -20.0 * 0.2f64.log10()).abs() < 1e-12);
        assert_eq!(psnr(&grey(7), &grey(7)), None);
    }

    #[test]
    fn only_masked_pixels_count() {
        let mut picture = grey(100);
        picture.put_pixel(0, 0, image::Rgb([0; 3]));
        let mut mask = GrayImage::new(4, 4);
        assert_eq!(masked_psnr(&picture, &grey(100), &mask), None);
        mask.put_pixel(0, 0, image::Luma([255]));
        let expected = -20.0 * (100.0f64 / 255.0).log10();
        assert!((masked_psnr(&picture, &grey(100), &mask).expect("one pixel") - expected).abs() < 1e-12);
    }

    #[test]
    fn overlap_is_pooled() {
        let mut overlap = MaskOverlap::default();
        assert_eq!(overlap.ratio(), None);
        overlap.add(&grey(255), &GrayImage::from_pixel(4, 4, image::Luma([255])));
        overlap.add(&grey(255), &GrayImage::new(4, 4));
        assert_eq!(overlap.ratio(), Some(0.5));
    }
}
