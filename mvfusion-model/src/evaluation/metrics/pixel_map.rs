//! A metric at each pixel, and its means over regions.

use burn::tensor::Tensor;
use image::GrayImage;

use crate::ModelError;
use crate::tensors;

/// Values at each channel and pixel of an image, on the host. Sums are in double precision and in row-major order.
#[derive(Clone, Debug, PartialEq)]
pub struct PixelMap {
    width: usize,
    height: usize,
    values: Vec<f64>,
}

impl PixelMap {
    /// The values of a map `[1, C, H, W]`.
    ///
    /// # Errors
    /// If the device fails to return values.
    pub fn read(map: Tensor<4>) -> Result<Self, ModelError> {
        let [_, _, height, width] = map.dims();
        Ok(Self { width, height, values: tensors::read(map)? })
    }

    /// Mean over all channels and pixels.
    pub fn mean(&self) -> f64 {
        self.values.iter().sum::<f64>() / self.values.len().max(1) as f64
    }

    /// Mean of each channel.
    pub fn channel_means(&self) -> Vec<f64> {
        let plane = (self.width * self.height).max(1);
        self.values.chunks(plane).map(|channel| channel.iter().sum::<f64>() / plane as f64).collect()
    }

    /// Mean without the `border` outermost pixels on each side; `None` if nothing remains.
    pub fn inner_mean(&self, border: usize) -> Option<f64> {
        self.mean_where(|x, y| self.is_inner(border, x, y))
    }

    /// Mean where a mask is white (128 or more); `None` if it is black everywhere.
    ///
    /// # Panics
    /// If the mask is smaller than the map.
    pub fn mean_over(&self, mask: &GrayImage) -> Option<f64> {
        self.mean_where(|x, y| is_white(mask, x, y))
    }

    /// Mean where a mask is white (128 or more), without the `border` outermost pixels of the map on each side; `None`
    /// if nothing remains.
    ///
    /// # Panics
    /// If the mask is smaller than the map.
    pub fn inner_mean_over(&self, border: usize, mask: &GrayImage) -> Option<f64> {
        self.mean_where(|x, y| self.is_inner(border, x, y) && is_white(mask, x, y))
    }

    /// Whether a pixel is at least `border` pixels from every side.
    fn is_inner(&self, border: usize, x: usize, y: usize) -> bool {
        let inside = |position: usize, length: usize| position >= border && position + border < length;
        inside(x, self.width) && inside(y, self.height)
    }

    fn mean_where(&self, counts: impl Fn(usize, usize) -> bool) -> Option<f64> {
        let plane = self.width * self.height;
        let pixels: Vec<usize> = (0..plane).filter(|&pixel| counts(pixel % self.width, pixel / self.width)).collect();
        let channels = self.values.chunks(plane.max(1));
        let sum: f64 = channels.map(|channel| pixels.iter().map(|&pixel| channel[pixel]).sum::<f64>()).sum();
        let count = pixels.len() * self.values.len() / plane.max(1);
        (count > 0).then(|| sum / count as f64)
    }
}

fn is_white(mask: &GrayImage, x: usize, y: usize) -> bool {
    mask.get_pixel(x as u32, y as u32).0[0] >= 128
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two channels of 4 by 3 pixels: 0 to 11, and 100 to 111.
    fn map() -> PixelMap {
        PixelMap { width: 4, height: 3, values: (0..12).chain(100..112).map(f64::from).collect() }
    }

    #[test]
    fn means_of_parts_are_those_counted_by_hand() {
        assert_eq!(map().mean(), (5.5 + 105.5) / 2.0);
        assert_eq!(map().channel_means(), [5.5, 105.5]);
        // Pixels 5 and 6 of each channel.
        assert_eq!(map().inner_mean(1), Some(55.5));
        assert_eq!(map().inner_mean(2), None);
        let mut mask = GrayImage::new(4, 3);
        assert_eq!(map().mean_over(&mask), None);
        mask.put_pixel(3, 2, image::Luma([128]));
        mask.put_pixel(0, 0, image::Luma([127]));
        assert_eq!(map().mean_over(&mask), Some(61.0));
    }

    #[test]
    fn what_counts_of_a_part_without_the_border_is_white_and_inside() {
        let mut mask = GrayImage::new(4, 3);
        // Pixel 11 of each channel, at the border.
        mask.put_pixel(3, 2, image::Luma([255]));
        assert_eq!(map().inner_mean_over(1, &mask), None);
        // Pixel 6, and 5 too dark to count.
        mask.put_pixel(2, 1, image::Luma([128]));
        mask.put_pixel(1, 1, image::Luma([127]));
        assert_eq!(map().inner_mean_over(1, &mask), Some(56.0));
        assert_eq!(map().inner_mean_over(0, &mask), map().mean_over(&mask));
        let all = GrayImage::from_pixel(4, 3, image::Luma([255]));
        assert_eq!(map().inner_mean_over(1, &all), map().inner_mean(1));
    }
}
