//! The training views and the order in which they are shown.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};
use image::RgbImage;
use mvfusion_data::{Camera, Scene, View};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::ModelError;
use crate::random::Stream;

/// The training views, decoded.
#[derive(Clone, Debug)]
pub struct Photos {
    views: Vec<Photo>,
}

/// One training view.
#[derive(Clone, Debug)]
pub struct Photo {
    /// The camera.
    pub camera: Camera,
    /// The moment.
    pub time: f64,
    /// The pixels.
    pub pixels: Arc<RgbImage>,
}

impl Photos {
    /// Decodes every training view of a scene.
    ///
    /// # Errors
    /// If a picture cannot be read. That all have one size, as batches need, the readers see to.
    pub fn load(scene: &Scene) -> Result<Self, ModelError> {
        let load = |view: &View| -> Result<Photo, ModelError> {
            Ok(Photo { camera: view.camera, time: view.time, pixels: view.image.rgb()? })
        };
        let views = scene.train.par_iter().map(load).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { views })
    }

    /// Number of views.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether there is no view.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// A view.
    pub fn get(&self, index: usize) -> &Photo {
        &self.views[index]
    }

    /// The given views as one batch `[B, 3, H, W]` in `[0, 1]`, without autodiff.
    pub fn stack(&self, indices: &[usize], device: &Device) -> Tensor<4> {
        let pictures = indices.iter().map(|&index| picture_tensor(&self.views[index].pixels, device)).collect();
        Tensor::cat(pictures, 0)
    }
}

/// A picture as `[1, 3, H, W]` in `[0, 1]`.
pub fn picture_tensor(picture: &RgbImage, device: &Device) -> Tensor<4> {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let bytes = picture.as_raw();
    let planes: Vec<f32> =
        (0..3).flat_map(|channel| bytes.iter().skip(channel).step_by(3).map(|&byte| f32::from(byte) / 255.0)).collect();
    Tensor::from_data(TensorData::new(planes, [1, 3, height, width]), &device.clone().inner())
}

/// Draws views without replacement; a new round begins when all were shown (METHOD §4.2).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sampler {
    remaining: Vec<usize>,
    /// Whether a round ended since this flag was last taken.
    pub round_ended: bool,
}

impl Sampler {
    /// The next `size` of `count` views.
    pub fn draw(&mut self, size: usize, count: usize, stream: &mut Stream) -> Vec<usize> {
        let next = |_| {
            if self.remaining.is_empty() {
                self.remaining = (0..count).collect();
            }
            let view = self.remaining.swap_remove(stream.index(self.remaining.len()));
            self.round_ended |= self.remaining.is_empty();
            view
        };
        (0..size).map(next).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_view_is_shown_once_a_round() {
        let mut sampler = Sampler::default();
        let mut stream = Stream::new(1, 0);
        let mut shown: Vec<usize> = (0..4).flat_map(|_| sampler.draw(3, 12, &mut stream)).collect();
        shown.sort_unstable();
        assert_eq!(shown, (0..12).collect::<Vec<_>>());
        assert!(sampler.round_ended);
    }

    #[test]
    fn a_batch_may_reach_into_the_next_round() {
        let mut sampler = Sampler::default();
        assert_eq!(sampler.draw(5, 2, &mut Stream::new(1, 0)).len(), 5);
    }
}
