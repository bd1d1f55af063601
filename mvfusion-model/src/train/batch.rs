//! The training views and their batches.

use std::sync::atomic::{AtomicBool, Ordering};

use burn::tensor::{Device, Tensor};
use image::{GrayImage, RgbImage};
use mvfusion_data::motion::MovingPixels;
use mvfusion_data::{Decoded, PictureCache, Scene};
use mvfusion_render::picture::planes;
use tracing::warn;

use super::{TrainingView, Visits};
use crate::ModelError;
use crate::evaluation::dilate;
use crate::timeline::Timeline;
use crate::train::loss::{MotionMasks, MotionWitness};

/// Dilation of moving pixels in the losses, because edges are blends of both branches.
const MOTION_REACH: usize = 2;

/// The training views.
#[derive(Debug)]
pub struct TrainingViews {
    views: Vec<TrainingView>,
    names: Vec<String>,
    pictures: PictureCache,
    /// Their moving pixels, if the losses need them.
    moving: Option<MovingPixels>,
    /// Whether a mask without a valid pixel was warned of.
    has_warned: AtomicBool,
}

/// The ground truth of a batch. Without autodiff.
#[derive(Clone, Debug)]
pub struct Batch {
    /// The photos, black at invalid pixels: `[B, 3, H, W]` in `[0, 1]`.
    pub photos: Tensor<4>,
    /// 1 at valid pixels, otherwise 0: `[B, 1, H, W]`; absent if all are valid.
    pub valid: Option<Tensor<4>>,
    /// Detected motion; absent if it is unknown in any view of the batch, because the masks cover all of them.
    pub motion: Option<MotionMasks>,
}

impl TrainingViews {
    /// The training views of a scene, with at most `budget` bytes of decoded images. Nothing is decoded yet.
    /// [`Scene::check`] ensures that all images have the same size, which batches need.
    pub fn new(scene: &Scene, budget: u64) -> Self {
        let views = scene.train.iter().zip(scene.training_cameras());
        let views = views.map(|(view, number)| TrainingView { camera: view.camera, time: view.time, number }).collect();
        let names = scene.train.iter().map(|view| view.name.clone()).collect();
        let pictures = PictureCache::new(&scene.train, budget, rayon::current_num_threads());
        Self { views, names, pictures, moving: None, has_warned: AtomicBool::new(false) }
    }

    /// Adds the known motion.
    pub fn with_motion(self, moving: Option<MovingPixels>) -> Self {
        Self { moving, ..self }
    }

    /// How often a round shows each view, with `lonely` additional visits for lonely moments.
    pub fn visits(&self, timeline: &Timeline, lonely: f64) -> Visits {
        match &self.moving {
            Some(moving) if lonely > 0.0 => Visits::by_loneliness(&self.views, moving, timeline, lonely),
            _ => Visits::even(self.views.len()),
        }
    }

    /// The detected motion of a view: 255 at moving pixels; `None` if unknown.
    pub fn moving_mask(&self, index: usize) -> Option<GrayImage> {
        self.moving.as_ref()?.mask(index)
    }

    /// The images.
    pub fn pictures(&self) -> &PictureCache {
        &self.pictures
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
    pub fn get(&self, index: usize) -> &TrainingView {
        &self.views[index]
    }

    /// Rejects an empty list of views, and indices that the scene does not have.
    ///
    /// # Errors
    /// [`ModelError::Views`] with the reason.
    pub fn check(&self, indices: &[usize]) -> Result<(), ModelError> {
        let refusal = |reason| Err(ModelError::Views { views: indices.to_vec(), reason });
        match indices.iter().find(|&&index| index >= self.len()) {
            Some(index) => refusal(format!("the scene has {} of them, so there is none of index {index}", self.len())),
            None if indices.is_empty() => refusal("a step needs at least one".to_owned()),
            None => Ok(()),
        }
    }

    /// The given views in words: their names and times.
    pub fn describe(&self, indices: &[usize]) -> String {
        let words = |&index: &usize| format!("the view `{}` at time {}", self.names[index], self.views[index].time);
        match indices {
            [] => "no view".to_owned(),
            indices => indices.iter().map(words).collect::<Vec<_>>().join(", "),
        }
    }

    /// The given views as one batch.
    ///
    /// # Errors
    /// If an image cannot be read.
    pub fn stack(&self, indices: &[usize], device: &Device) -> Result<Batch, ModelError> {
        let decoded = indices.iter().map(|&index| self.pictures.get(index)).collect::<Result<Vec<_>, _>>()?;
        let photos = Tensor::cat(decoded.iter().map(|photo| picture_tensor(&photo.rgb, device)).collect(), 0);
        if decoded.iter().all(|photo| photo.valid.is_none()) {
            return Ok(Batch { photos, valid: None, motion: self.motion_masks(indices, device) });
        }
        for (photo, &index) in decoded.iter().zip(indices) {
            self.warn_of_empty(photo, index);
        }
        let mask = |photo: &Decoded| match &photo.valid {
            Some(mask) => mask_tensor(mask, device),
            None => Tensor::ones([1, 1, photo.rgb.height() as usize, photo.rgb.width() as usize], &inner(device)),
        };
        let valid = Tensor::cat(decoded.iter().map(mask).collect(), 0);
        let motion = self.motion_masks(indices, device);
        Ok(Batch { photos: photos * valid.clone(), valid: Some(valid), motion })
    }

    /// Warns, once, of a view of whose pixels none is valid. It may be all views, if the masks are inverted.
    fn warn_of_empty(&self, photo: &Decoded, index: usize) {
        let is_empty = photo.valid.as_ref().is_some_and(|mask| mask.pixels().all(|valid| valid.0[0] == 0));
        if is_empty && !self.has_warned.swap(true, Ordering::Relaxed) {
            warn!(
                "the mask of the view `{}` excludes every pixel, so nothing is learned from it. If masks are white where \
                 pixels are to be ignored, set scene.invert_masks=true.",
                self.names[index]
            );
        }
    }

    /// [`Batch::motion`] of the given views: masks of all of them, or none.
    fn motion_masks(&self, indices: &[usize], device: &Device) -> Option<MotionMasks> {
        let moving = self.moving.as_ref()?;
        let masks = indices.iter().map(|&index| moving.mask(index)).collect::<Option<Vec<_>>>()?;
        let tensor = |mask: &GrayImage| mask_tensor(mask, device);
        let around = masks.iter().map(|mask| tensor(&dilate(mask, MOTION_REACH))).collect();
        let [moving, around] = [masks.iter().map(tensor).collect(), around].map(|masks| Tensor::cat(masks, 0));
        Some(MotionMasks::new(moving, around, MotionWitness::StillCamera))
    }
}

/// An image as `[1, 3, H, W]` in `[0, 1]`.
pub fn picture_tensor(picture: &RgbImage, device: &Device) -> Tensor<4> {
    planes(picture.as_raw(), [picture.height() as usize, picture.width() as usize, 3], device)
}

/// A mask as `[1, 1, H, W]`: 1 where it is white.
pub fn mask_tensor(mask: &GrayImage, device: &Device) -> Tensor<4> {
    planes(mask.as_raw(), [mask.height() as usize, mask.width() as usize, 1], device)
}

fn inner(device: &Device) -> Device {
    device.clone().inner()
}
