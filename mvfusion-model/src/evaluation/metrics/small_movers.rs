//! Recall of small movers by a predicted mask. A hand or a ball hardly affects a mean over pixels.

use image::{GrayImage, RgbImage};
use serde::{Deserialize, Serialize};

/// Fraction of the image below which a connected component of the true mask is small.
pub const SMALL: f64 = 0.01;

/// Recall of small movers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SmallMoversRecall {
    /// Fraction of the pixels of all small components in all views that the predicted mask (at least 0.5) covers.
    pub recall: f64,
    /// Number of components, counted separately in each view.
    pub components: usize,
}

/// Small components of true masks and their coverage by predicted masks, pooled over views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SmallMovers {
    components: usize,
    pixels: usize,
    covered: usize,
}

impl SmallMovers {
    /// Adds a view: a predicted mask in `0..=255` with the size of the true mask. Both are white from 128 on.
    pub fn add(&mut self, predicted: &RgbImage, truth: &GrayImage) {
        let limit = SMALL * truth.as_raw().len() as f64;
        for component in components(truth).into_iter().filter(|component| (component.len() as f64) < limit) {
            self.components += 1;
            self.pixels += component.len();
            let is_covered = |&&(x, y): &&(u32, u32)| predicted.get_pixel(x, y).0[0] >= 128;
            self.covered += component.iter().filter(is_covered).count();
        }
    }

    /// Adds the views of another instance.
    pub fn merge(&mut self, other: Self) {
        self.components += other.components;
        self.pixels += other.pixels;
        self.covered += other.covered;
    }

    /// The recall; `None` without small components.
    pub fn recall(&self) -> Option<SmallMoversRecall> {
        let recall =
            || SmallMoversRecall { recall: self.covered as f64 / self.pixels as f64, components: self.components };
        (self.components > 0).then(recall)
    }
}

/// The 8-connected components of a mask's white pixels (128 or more): the pixels (x, y) of each, in the order of their
/// first pixels, row by row.
pub fn components(mask: &GrayImage) -> Vec<Vec<(u32, u32)>> {
    let (width, height) = mask.dimensions();
    let mut left: Vec<bool> = mask.as_raw().iter().map(|&level| level >= 128).collect();
    let mut take = |x: u32, y: u32| std::mem::take(&mut left[(y * width + x) as usize]);
    let mut components = Vec::new();
    for (first_x, first_y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        if !take(first_x, first_y) {
            continue;
        }
        let mut component = vec![(first_x, first_y)];
        let mut next = 0;
        while let Some(&(x, y)) = component.get(next) {
            next += 1;
            for near_y in y.saturating_sub(1)..(y + 2).min(height) {
                for near_x in x.saturating_sub(1)..(x + 2).min(width) {
                    if take(near_x, near_y) {
                        component.push((near_x, near_y));
                    }
                }
            }
        }
        components.push(component);
    }
    components
}

#[cfg(test)]
mod tests {
    use image::{Luma, Rgb};

    use super::*;

    /// A mask of 20 by 20 pixels; four pixels are 1 % of it.
    fn mask(white: &[(u32, u32)]) -> GrayImage {
        GrayImage::from_fn(20, 20, |x, y| Luma([if white.contains(&(x, y)) { 255 } else { 0 }]))
    }

    fn predicted(white: &[(u32, u32)]) -> RgbImage {
        RgbImage::from_fn(20, 20, |x, y| Rgb([if white.contains(&(x, y)) { 128 } else { 127 }; 3]))
    }

    #[test]
    fn pixels_that_touch_by_a_corner_are_one_component_and_a_gap_parts() {
        // A diagonal that turns back to the left, the last column, and a pixel at the start of the next row, which
        // follows in memory.
        let found = components(&mask(&[(3, 0), (2, 1), (3, 2), (19, 4), (19, 5), (0, 6), (5, 2)]));
        assert_eq!(found, [vec![(3, 0), (2, 1), (3, 2)], vec![(5, 2)], vec![(19, 4), (19, 5)], vec![(0, 6)]]);
        assert!(components(&mask(&[])).is_empty());
        assert_eq!(components(&GrayImage::from_pixel(7, 5, Luma([128]))).len(), 1);
    }

    #[test]
    fn recall_is_of_small_components_alone_and_pooled() {
        let large = [(10, 10), (10, 11), (11, 10), (11, 11)];
        let small = [(0, 0), (1, 1), (2, 2)];
        let mut movers = SmallMovers::default();
        movers.add(&predicted(&large), &mask(&large));
        assert_eq!(movers.recall(), None, "a hundredth is not small");
        movers.add(&predicted(&[(1, 1), (2, 2), (9, 9)]), &mask(&[&large[..], &small].concat()));
        assert_eq!(movers.recall(), Some(SmallMoversRecall { recall: 2.0 / 3.0, components: 1 }));
        let mut other = SmallMovers::default();
        other.add(&predicted(&[]), &mask(&[(5, 5)]));
        movers.merge(other);
        assert_eq!(movers.recall(), Some(SmallMoversRecall { recall: 0.5, components: 2 }));
    }
}
