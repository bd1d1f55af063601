//! Images as masks: the threshold of white, and the check of the aspect ratio.

use std::path::Path;

use image::{ColorType, DynamicImage, GrayImage, Rgba};

use crate::error::DataError;

/// 255 where an image is white, 0 where it is black, by the rule of [`Picture::mask`].
pub(crate) fn black_and_white(mask: DynamicImage) -> GrayImage {
    /// Half of the brightest level.
    const HALF: u32 = 1 << 15;
    // The level of a 1 in the file after its 8 bits became 16.
    let one = match mask.color() {
        ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => Some(0x101),
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => Some(1),
        _ => None,
    };
    let mask = mask.into_rgba16();
    let level = |&Rgba([r, g, b, alpha]): &Rgba<u16>| u32::from(r.max(g).max(b)) * u32::from(alpha) / 0xffff;
    let white = one.filter(|&one| mask.pixels().all(|pixel| level(pixel) <= one)).unwrap_or(HALF);
    GrayImage::from_fn(mask.width(), mask.height(), |x, y| {
        image::Luma([if level(mask.get_pixel(x, y)) >= white { 255 } else { 0 }])
    })
}

/// Checks that a file of the first size has the aspect ratio of the second size, to which it is to be resized. Each side
/// may be off by a pixel of rounding.
///
/// # Errors
/// [`DataError::Image`] if the aspect ratios differ. A stretched mask would cover the wrong pixels, and a picture of one
/// long row would be resized through a picture as wide and as high as needed.
pub(crate) fn check_shape(path: &Path, found: (u32, u32), wanted: (u32, u32)) -> Result<(), DataError> {
    let [w, h, width, height] = [found.0, found.1, wanted.0, wanted.1].map(u64::from);
    if (w * height).abs_diff(h * width) <= w + h + width + height {
        return Ok(());
    }
    let reason = format!("it has {w} x {h} pixels, another shape than the {width} x {height} that it is used for");
    let advice = "Make the mask again in the shape of its image, or remove the mask";
    Err(DataError::Content { path: path.to_owned(), reason, advice })
}
