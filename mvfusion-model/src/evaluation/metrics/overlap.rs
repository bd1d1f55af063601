//! IoU of predicted and true masks.

use image::{GrayImage, RgbImage};

/// Overlap of predicted and true masks, pooled over views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MaskOverlap {
    both: usize,
    either: usize,
}

impl MaskOverlap {
    /// Adds a view: a predicted mask in `0..=255` with the size of the true mask. Both are white from 128 on.
    ///
    /// # Panics
    /// If their sizes differ.
    pub fn add(&mut self, predicted: &RgbImage, truth: &GrayImage) {
        assert_eq!(predicted.dimensions(), truth.dimensions(), "masks of one size are compared");
        for (p, t) in predicted.pixels().zip(truth.pixels()) {
            let (p, t) = (p.0[0] >= 128, t.0[0] >= 128);
            self.both += usize::from(p && t);
            self.either += usize::from(p || t);
        }
    }

    /// Adds the views of another overlap.
    pub fn merge(&mut self, other: Self) {
        self.both += other.both;
        self.either += other.either;
    }

    /// Intersection over union; `None` if both were black everywhere.
    pub fn ratio(&self) -> Option<f64> {
        (self.either > 0).then(|| self.both as f64 / self.either as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grey(level: u8) -> RgbImage {
        RgbImage::from_pixel(4, 4, image::Rgb([level; 3]))
    }

    #[test]
    fn overlap_is_pooled() {
        let mut overlap = MaskOverlap::default();
        assert_eq!(overlap.ratio(), None);
        overlap.add(&grey(255), &GrayImage::from_pixel(4, 4, image::Luma([255])));
        overlap.add(&grey(255), &GrayImage::new(4, 4));
        assert_eq!(overlap.ratio(), Some(0.5));
    }
}
