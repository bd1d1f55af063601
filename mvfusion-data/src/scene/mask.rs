//! A mask of valid pixels.

use image::{GrayImage, imageops};

use super::picture::Picture;
use crate::error::DataError;

/// The valid pixels of an image, for losses and metrics.
#[derive(Clone, Debug)]
pub struct Mask {
    /// Decoded by [`Picture::mask`].
    pub picture: Picture,
    /// Whether black pixels are valid and white ones are ignored. Otherwise white pixels are valid, as in nerfstudio
    /// and COLMAP.
    pub inverted: bool,
}

impl Mask {
    /// The decoded mask: 255 at valid pixels, 0 at ignored pixels.
    ///
    /// # Errors
    /// Same as [`Picture::mask`].
    pub fn read(&self) -> Result<GrayImage, DataError> {
        let mut mask = self.picture.mask()?;
        if self.inverted {
            imageops::invert(&mut mask);
        }
        Ok(mask)
    }
}

#[cfg(test)]
mod tests {
    use image::{ImageBuffer, Luma, LumaA, Rgb, Rgba};

    use super::*;

    const SIZE: (u32, u32) = (24, 18);

    /// A mask of two colours, read from a file. The left colour should be white.
    fn read<P>(left: P, right: P, inverted: bool) -> [u8; 2]
    where
        P: image::Pixel + image::PixelWithColorType,
        [P::Subpixel]: image::EncodableLayout,
    {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("mask.png");
        let side = |x| if x < SIZE.0 / 2 { left } else { right };
        ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, _| side(x)).save(&path).expect("written");
        let mask = Mask { picture: Picture::file(path, SIZE), inverted }.read().expect("read");
        assert!(mask.pixels().all(|pixel| matches!(pixel.0[0], 0 | 255)));
        [mask.get_pixel(0, 9).0[0], mask.get_pixel(SIZE.0 - 1, 9).0[0]]
    }

    #[test]
    fn what_is_at_least_half_as_bright_as_can_be_counts() {
        const WHITE_LEFT: [u8; 2] = [255, 0];
        assert_eq!(read(Luma([255u8]), Luma([0]), false), WHITE_LEFT);
        assert_eq!(read(Luma([128u8]), Luma([127]), false), WHITE_LEFT);
        assert_eq!(read(Luma([0x8000u16]), Luma([0x7fff]), false), WHITE_LEFT);
        assert_eq!(read(Rgb([0u8, 0, 128]), Rgb([127, 127, 127]), false), WHITE_LEFT);
        assert_eq!(read(LumaA([255u8, 255]), LumaA([255, 0]), false), WHITE_LEFT);
        assert_eq!(read(Rgba([255u8, 255, 255, 200]), Rgba([255, 255, 255, 100]), false), WHITE_LEFT);
        assert_eq!(read(Luma([127u8]), Luma([128]), true), WHITE_LEFT);
        assert_eq!(read(Luma([255u8]), Luma([255]), false), [255, 255]);
    }

    #[test]
    fn a_file_of_noughts_and_ones_holds_labels() {
        assert_eq!(read(Luma([1u8]), Luma([0]), false), [255, 0]);
        assert_eq!(read(Luma([1u16]), Luma([0]), false), [255, 0]);
        assert_eq!(read(Luma([0u16]), Luma([1]), true), [255, 0]);
        assert_eq!(read(Luma([1u8]), Luma([1]), false), [255, 255]);
        assert_eq!(read(Luma([0u8]), Luma([0]), false), [0, 0]);
        // Two is not a label, so dark values are black.
        assert_eq!(read(Luma([1u8]), Luma([2]), false), [0, 0]);
    }

    #[test]
    fn a_mask_of_another_shape_is_refused_and_one_of_another_size_is_not() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("mask.png");
        let read = |width, height, picture| {
            GrayImage::from_pixel(width, height, Luma([255])).save(&path).expect("written");
            Picture::file(path.clone(), picture).mask()
        };
        for (width, height, picture) in [(96, 72, SIZE), (12, 9, SIZE), (251, 167, (125, 83)), (96, 72, (1352, 1014))] {
            assert_eq!(read(width, height, picture).expect("scaled").dimensions(), picture);
        }
        for (width, height, picture) in [(180, 240, (240, 180)), (1080, 1920, (1920, 1080)), (640, 480, (640, 360))] {
            let error = read(width, height, picture).expect_err("another shape").to_string();
            assert!(error.contains("mask.png") && error.contains("another shape"), "{error}");
        }
    }
}
