//! Hashes of image sets.

use image::{ImageBuffer, Pixel};
use mvfusion_model::files::sha256;

/// The SHA-256 of a set of images: the hash of the concatenated hexadecimal hashes of its images. The hash of an image
/// covers width and height, as 4 bytes each in little-endian order, and its 8-bit pixels.
#[derive(Clone, Debug)]
pub struct PicturesHash {
    digests: Vec<String>,
}

impl PicturesHash {
    /// A hash of this number of images.
    pub fn new(pictures: usize) -> Self {
        Self { digests: vec![String::new(); pictures] }
    }

    /// Adds the image with this index.
    pub fn add<P: Pixel<Subpixel = u8>>(&mut self, index: usize, picture: &ImageBuffer<P, Vec<u8>>) {
        let (width, height) = picture.dimensions();
        self.digests[index] = sha256(&[&width.to_le_bytes(), &height.to_le_bytes(), &picture.as_raw()[..]].concat());
    }

    /// The hash of all added images.
    pub fn finish(self) -> String {
        sha256(self.digests.concat().as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use image::RgbImage;

    use super::*;

    #[test]
    fn the_order_of_work_does_not_count_and_shape_pixels_and_places_do() {
        let grey = |width, height, level| RgbImage::from_pixel(width, height, image::Rgb([level; 3]));
        let hash = |pictures: [(usize, RgbImage); 2]| {
            let mut hash = PicturesHash::new(2);
            for (index, picture) in &pictures {
                hash.add(*index, picture);
            }
            hash.finish()
        };
        let [a, b] = [grey(2, 3, 7), grey(3, 2, 7)];
        let set = hash([(0, a.clone()), (1, b.clone())]);
        assert_eq!(set, hash([(1, b.clone()), (0, a.clone())]));
        assert_ne!(set, hash([(0, b.clone()), (1, a.clone())]));
        assert_ne!(set, hash([(0, a), (1, grey(3, 2, 8))]));
    }
}
