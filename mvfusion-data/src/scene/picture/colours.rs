//! Conversion of decoded images to RGB with 8 bits per channel.

use image::{DynamicImage, RgbImage};

/// Converts to 8 bits per channel. Deeper channels are rounded. Linear light (the floats of an EXR file) becomes sRGB.
/// Transparent pixels show the backdrop. Colours of an EXR file are premultiplied by alpha; colours of a PNG file are
/// not.
pub(super) fn to_rgb8(image: DynamicImage, backdrop: Option<[u8; 3]>) -> RgbImage {
    let image = match image {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            let mut linear = image.into_rgba32f();
            for pixel in linear.pixels_mut() {
                let alpha = pixel.0[3];
                let share = if alpha > 0.0 && alpha < 1.0 { alpha } else { 1.0 };
                for channel in &mut pixel.0[..3] {
                    *channel = srgb(*channel / share);
                }
            }
            DynamicImage::ImageRgba32F(linear)
        }
        other => other,
    };
    let Some(backdrop) = backdrop.filter(|_| image.color().has_alpha()) else { return image.into_rgb8() };
    let image = image.into_rgba8();
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let image::Rgba([r, g, b, a]) = *image.get_pixel(x, y);
        let alpha = f32::from(a) / 255.0;
        let over =
            |colour: u8, behind: u8| (alpha * f32::from(colour) + (1.0 - alpha) * f32::from(behind)).round() as u8;
        image::Rgb([over(r, backdrop[0]), over(g, backdrop[1]), over(b, backdrop[2])])
    })
}

/// The transfer function of sRGB (IEC 61966-2-1). NaN becomes 0.
fn srgb(linear: f32) -> f32 {
    let linear = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_bits_and_linear_floats_become_eight() {
        let deep = image::ImageBuffer::from_pixel(16, 16, image::Rgb([0x8180u16, 0xffff, 0]));
        assert_eq!(to_rgb8(DynamicImage::ImageRgb16(deep), None).get_pixel(3, 3).0, [0x81, 255, 0]);
        let linear = image::Rgb32FImage::from_pixel(16, 16, image::Rgb([0.215_861, 3.0, f32::NAN]));
        assert_eq!(to_rgb8(DynamicImage::ImageRgb32F(linear), None).get_pixel(3, 3).0, [128, 255, 0]);
    }

    #[test]
    fn colours_that_were_multiplied_by_their_alpha_are_divided_by_it() {
        let half = image::Rgba32FImage::from_pixel(16, 16, image::Rgba([0.5 * 0.215_861, 0.5, 0.0, 0.5]));
        let image = to_rgb8(DynamicImage::ImageRgba32F(half), Some([0; 3]));
        assert_eq!(image.get_pixel(3, 3).0, [64, 128, 0]);
    }
}
