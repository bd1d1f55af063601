//! Images for people who wait for them: fast to make and small, not exact.

use std::io;

use image::codecs::jpeg::JpegEncoder;
use image::imageops::{self, FilterType};
use image::{ExtendedColorType, GrayImage, RgbImage};

/// An image as a JPEG file. `quality` goes from 1 to 100.
///
/// # Errors
/// If a side has more than 65 535 pixels, which the format cannot express.
pub fn jpeg(picture: &RgbImage, quality: u8) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let (width, height) = picture.dimensions();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, quality.clamp(1, 100));
    encoder.encode(picture.as_raw(), width, height, ExtendedColorType::Rgb8).map_err(io::Error::other)?;
    Ok(bytes)
}

/// An image in another size.
pub fn resized(picture: &RgbImage, width: u32, height: u32) -> RgbImage {
    match picture.dimensions() == (width, height) {
        true => picture.clone(),
        false => imageops::resize(picture, width, height, FilterType::Triangle),
    }
}

/// A mask in another size; each pixel is one of the mask's.
pub fn resized_mask(mask: &GrayImage, width: u32, height: u32) -> GrayImage {
    imageops::resize(mask, width, height, FilterType::Nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jpeg_shows_the_picture_and_a_lower_quality_is_smaller() {
        let picture = RgbImage::from_fn(64, 48, |x, y| image::Rgb([4 * x as u8, 5 * y as u8, ((x * y) % 256) as u8]));
        let (fine, coarse) = (jpeg(&picture, 95).expect("encoded"), jpeg(&picture, 30).expect("encoded"));
        assert!(coarse.len() < fine.len());
        let read = image::load_from_memory(&fine).expect("decoded").into_rgb8();
        assert_eq!(read.dimensions(), picture.dimensions());
        let error: f64 = read.as_raw().iter().zip(picture.as_raw()).map(|(&a, &b)| f64::from(a.abs_diff(b))).sum();
        assert!(error / (3.0 * 64.0 * 48.0) < 8.0, "{error}");
    }

    #[test]
    fn a_picture_has_the_size_that_is_asked_for() {
        let picture = RgbImage::from_pixel(64, 48, image::Rgb([9, 8, 7]));
        assert_eq!(resized(&picture, 64, 48), picture);
        assert_eq!(resized(&picture, 32, 20), RgbImage::from_pixel(32, 20, image::Rgb([9, 8, 7])));
    }
}
