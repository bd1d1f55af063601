//! Images as masks: the threshold of white.

use image::{ColorType, DynamicImage, GrayImage, Rgba};

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
