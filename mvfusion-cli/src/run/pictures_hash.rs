//! Hashes of image sets.

use image::{ImageBuffer, Pixel};
use mvfusion_data::{DataError, View};
use mvfusion_model::files::sha256;
use rayon::prelude::*;

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

    /// A hash of the photos of some views, which are decoded for it.
    ///
    /// # Errors
    /// If a photo cannot be read.
    pub fn of_photos(views: &[View]) -> Result<Self, DataError> {
        let digests = views.par_iter().map(|view| Ok(digest(&*view.image.rgb()?)));
        Ok(Self { digests: digests.collect::<Result<_, DataError>>()? })
    }

    /// Adds the image with this index.
    pub fn add<P: Pixel<Subpixel = u8>>(&mut self, index: usize, picture: &ImageBuffer<P, Vec<u8>>) {
        self.digests[index] = digest(picture);
    }

    /// The hash of all added images.
    pub fn finish(self) -> String {
        sha256(self.digests.concat().as_bytes())
    }
}

fn digest<P: Pixel<Subpixel = u8>>(picture: &ImageBuffer<P, Vec<u8>>) -> String {
    let (width, height) = picture.dimensions();
    sha256(&[&width.to_le_bytes(), &height.to_le_bytes(), &picture.as_raw()[..]].concat())
}

#[cfg(test)]
mod tests {
    use image::RgbImage;
    use mvfusion_data::{BuiltinOptions, builtin};

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

    #[test]
    fn the_photos_of_views_have_the_hash_of_their_images() {
        let scene = builtin::builtin(&BuiltinOptions { width: 16, height: 16, frames: 2, ..Default::default() });
        let mut hash = PicturesHash::new(scene.test.len());
        for (index, view) in scene.test.iter().enumerate() {
            hash.add(index, &*view.image.rgb().expect("in memory"));
        }
        assert_eq!(PicturesHash::of_photos(&scene.test).expect("in memory").finish(), hash.finish());
    }
}
