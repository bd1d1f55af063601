//! An image embedded in the page, as a data URI.

use std::io::{self, Cursor};
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
use image::{DynamicImage, ImageFormat, ImageReader};
use mvfusion_data::files::read_bytes;

use super::files::{Found, Missing};
use crate::run::MOST_OF_PICTURE;

/// PNG files up to this many bytes are embedded unchanged.
const SMALL: usize = 48 * 1024;

/// JPEG quality of all other images.
pub(super) const QUALITY: u8 = 90;

/// An image of the page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Embedded {
    /// `data:image/…`.
    pub uri: String,
    /// Width of the file, pixels.
    pub width: u32,
    /// Height of the file, pixels.
    pub height: u32,
}

/// Embeds a PNG file: unchanged if it is small and no wider than `widest`, otherwise as a JPEG of at most that width.
///
/// # Errors
/// A [`Missing`] that names the file as `name` if it is missing or not an image.
pub(super) fn embed(path: &Path, name: &str, widest: u32) -> Found<Embedded> {
    let bytes = read_bytes(path, MOST_OF_PICTURE).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => Missing::new(format!("The file {name} is missing.")),
        _ => Missing::new(format!("{name} cannot be read: {error}.")),
    })?;
    // Decoded even if it is embedded unchanged, because a browser would show a broken image without a message.
    let picture = ImageReader::with_format(Cursor::new(&bytes), ImageFormat::Png).decode();
    let wrong = |error| Missing::new(format!("{name} is not an image: {error}."));
    let picture = picture.map_err(wrong)?;
    let (width, height) = (picture.width(), picture.height());
    let uri = match bytes.len() <= SMALL && width <= widest {
        true => format!("data:image/png;base64,{}", STANDARD.encode(&bytes)),
        false => format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg(picture, widest).map_err(wrong)?)),
    };
    Ok(Embedded { uri, width, height })
}

fn jpeg(picture: DynamicImage, widest: u32) -> image::ImageResult<Vec<u8>> {
    let small = match picture.width() > widest {
        true => picture.resize(widest, u32::MAX, FilterType::CatmullRom),
        false => picture,
    };
    let mut bytes = Vec::new();
    small.into_rgb8().write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, QUALITY))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    /// Decodes what stands behind `start`.
    fn decoded(uri: &str, start: &str) -> RgbImage {
        let bytes = STANDARD.decode(uri.strip_prefix(start).expect("the format")).expect("base64");
        image::load_from_memory(&bytes).expect("a picture").into_rgb8()
    }

    #[test]
    fn small_pictures_stay_as_they_are_and_large_ones_become_narrower() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.png");
        let small = RgbImage::from_fn(40, 20, |x, y| Rgb([x as u8, y as u8, 7]));
        small.save(&path).expect("saved");
        let embedded = embed(&path, "a.png", 40).expect("embedded");
        assert_eq!(decoded(&embedded.uri, "data:image/png;base64,"), small);
        let narrow = embed(&path, "a.png", 20).expect("embedded");
        assert_eq!((narrow.width, narrow.height), (40, 20));
        assert_eq!(decoded(&narrow.uri, "data:image/jpeg;base64,").dimensions(), (20, 10));

        // Noise, which no PNG makes small.
        let noise =
            RgbImage::from_fn(200, 200, |x, y| Rgb([1, 5, 9].map(|k| (x * x * k + y * y * 31 + x * y * 7) as u8)));
        noise.save(&path).expect("saved");
        let large = embed(&path, "a.png", 960).expect("embedded");
        assert_eq!(decoded(&large.uri, "data:image/jpeg;base64,").dimensions(), (200, 200));
    }

    #[test]
    fn what_is_no_picture_is_named() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.png");
        let sentence = |path: &Path| embed(path, "layer/a.png", 960).expect_err("missing").to_string();
        assert_eq!(sentence(&path), "The file layer/a.png is missing.");
        std::fs::write(&path, b"\x89PNG\r\n\x1a\n and no more").expect("written");
        assert!(sentence(&path).starts_with("layer/a.png is not an image"), "{}", sentence(&path));
    }
}
