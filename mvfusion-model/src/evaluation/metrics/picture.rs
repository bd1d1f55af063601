//! Images in 8 bits.

use burn::tensor::Tensor;
use image::RgbImage;

use crate::ModelError;
use crate::tensors;

/// An image `[1, 3, H, W]` (or one channel, repeated) as 8-bit RGB, clamped and rounded.
///
/// # Errors
/// If the device fails to return values.
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
