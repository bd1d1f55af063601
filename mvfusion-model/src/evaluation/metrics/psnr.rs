//! Peak signal-to-noise ratio.

use burn::tensor::Tensor;
use image::{GrayImage, RgbImage};

use super::PixelMap;
use crate::ModelError;

/// A peak signal-to-noise ratio in dB; `None` for equal images, whose ratio is infinite, and for empty regions.
pub type Psnr = Option<f64>;

/// PSNR for values in `[0, 1]` from the mean squared error.
pub fn decibels(squared_error: f64) -> Psnr {
    (squared_error > 0.0).then(|| -10.0 * squared_error.log10())
}

/// PSNR of two 8-bit images of the same size, over all pixels and channels.
///
/// # Panics
/// If their sizes differ.
pub fn psnr(picture: &RgbImage, reference: &RgbImage) -> Psnr {
    assert_eq!(picture.dimensions(), reference.dimensions(), "images of one size are compared");
    let errors = picture.as_raw().iter().zip(reference.as_raw()).map(|(&a, &b)| squared(a, b));
    decibels(errors.sum::<f64>() / picture.as_raw().len().max(1) as f64)
}

/// PSNR over the pixels where the mask is white (128 or more). The mask has the size of the images.
///
/// # Panics
/// If their sizes differ.
pub fn masked_psnr(picture: &RgbImage, reference: &RgbImage, mask: &GrayImage) -> Psnr {
    let sizes = [picture.dimensions(), reference.dimensions()];
    assert_eq!(sizes, [mask.dimensions(); 2], "images and mask have one size");
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

/// Squared differences of two images `[1, 3, H, W]` in `[0, 1]`; [`decibels`] of their mean is the PSNR without the
/// 8-bit round trip.
///
/// # Errors
/// If the device fails to return values.
pub fn squared_errors(picture: Tensor<4>, reference: Tensor<4>) -> Result<PixelMap, ModelError> {
    PixelMap::read((picture - reference).square())
}

fn squared(a: u8, b: u8) -> f64 {
    let difference = (f64::from(a) - f64::from(b)) / 255.0;
    difference * difference
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
    #[should_panic(expected = "images of one size are compared")]
    fn images_of_two_sizes_are_not_compared() {
        psnr(&RgbImage::new(8, 4), &grey(0));
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
}
