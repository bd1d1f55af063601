//! A part of a scene that stands for the whole in a probe: some of its moments, in memory, perhaps reduced.

use std::sync::Arc;
use std::time::Instant;

use image::imageops::{self, FilterType};
use mvfusion_data::{Camera, DataError, Picture, Scene, Truth, View};
use rayon::prelude::*;

/// Pixels of the sampled images together, unless the scene has more in its fewest moments.
const PIXELS: f64 = 4e7;

/// Fewest moments: motion is only seen in several.
const LEAST_MOMENTS: usize = 4;

/// Smallest side of a reduced image, in pixels. Windows of SSIM fit into it.
const LEAST_SIDE: usize = 16;

/// Some moments of a scene.
pub(super) struct Sample {
    /// The scene with these moments alone; its training images are decoded.
    pub scene: Scene,
    /// Share of the training views.
    pub share: f64,
    /// Seconds that decoding took.
    pub seconds: f64,
}

impl Sample {
    /// Evenly spaced moments with all of their views.
    pub fn of(scene: &Scene) -> Result<Self, DataError> {
        let started = Instant::now();
        let times = scene.training_times();
        let kept = moments(scene, times.len());
        let times: Vec<f64> = (0..kept).map(|index| times[index * times.len() / kept]).collect();
        let views: Vec<&View> = scene.train.iter().filter(|view| times.contains(&view.time)).collect();
        let share = views.len() as f64 / scene.train.len() as f64;
        let train = views.into_par_iter().map(|view| reduced(view, 1.0)).collect::<Result<_, _>>()?;
        let scene = Scene { train, test: Vec::new(), name: scene.name.clone(), points: scene.points.clone(), ..*scene };
        Ok(Self { scene, share, seconds: started.elapsed().as_secs_f64() })
    }

    /// The scene with about this share of its pixels.
    pub fn with_pixels(&self, share: f64) -> Result<Scene, DataError> {
        let train = self.scene.train.par_iter().map(|view| reduced(view, share)).collect::<Result<_, _>>()?;
        Ok(Scene { train, ..self.scene.clone() })
    }
}

/// How many moments are sampled.
fn moments(scene: &Scene, times: usize) -> usize {
    let pixels: f64 = scene.train.iter().map(|view| view.camera.width as f64 * view.camera.height as f64).sum();
    let of_moment = pixels / times as f64;
    ((PIXELS / of_moment) as usize).clamp(LEAST_MOMENTS.min(times), times)
}

/// A training view whose image is in memory, with about this share of its pixels.
fn reduced(view: &View, share: f64) -> Result<View, DataError> {
    let camera = reduced_camera(&view.camera, share);
    let image = reduced_picture(&view.image, &camera)?;
    Ok(View { name: view.name.clone(), camera, time: view.time, image, mask: None, truth: Truth::default() })
}

/// A held-out view with its ground truth, likewise. Depths are left out.
pub(super) fn reduced_with_truth(view: &View, share: f64) -> Result<View, DataError> {
    let plain = reduced(view, share)?;
    let picture =
        |picture: &Option<Picture>| picture.as_ref().map(|picture| reduced_picture(picture, &plain.camera)).transpose();
    let truth = Truth {
        background: picture(&view.truth.background)?,
        dynamic_mask: picture(&view.truth.dynamic_mask)?,
        movers_mask: picture(&view.truth.movers_mask)?,
        is_mask_exact: view.truth.is_mask_exact,
        depth: None,
    };
    Ok(View { truth, ..plain })
}

fn reduced_camera(camera: &Camera, share: f64) -> Camera {
    let side = |pixels: usize| match share < 1.0 {
        true => ((pixels as f64 * share.sqrt()).round() as usize).clamp(LEAST_SIDE.min(pixels), pixels),
        false => pixels,
    };
    camera.resized(side(camera.width), side(camera.height))
}

/// The image for the size of a camera.
fn reduced_picture(picture: &Picture, camera: &Camera) -> Result<Picture, DataError> {
    let image = picture.rgb()?;
    let (width, height) = (camera.width as u32, camera.height as u32);
    Ok(Picture::Memory(match image.dimensions() == (width, height) {
        true => image,
        false => Arc::new(imageops::resize(&*image, width, height, FilterType::Triangle)),
    }))
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;

    fn scene() -> Scene {
        builtin::builtin(&BuiltinOptions { width: 64, height: 48, frames: 6, ..Default::default() })
    }

    #[test]
    fn a_small_scene_is_sampled_whole_and_a_large_one_at_a_few_moments() {
        let whole = scene();
        let sample = Sample::of(&whole).expect("in memory");
        assert_eq!((sample.scene.train.len(), sample.share), (whole.train.len(), 1.0));
        let mut large = whole;
        large.train.iter_mut().for_each(|view| view.camera = view.camera.resized(64_000, 48_000));
        assert_eq!(moments(&large, 6), LEAST_MOMENTS);
    }

    #[test]
    fn a_reduced_view_has_the_camera_and_the_images_of_its_size() {
        let scene = scene();
        let view = reduced_with_truth(&scene.test[0], 0.25).expect("in memory");
        assert_eq!((view.camera.width, view.camera.height, view.image.size()), (32, 24, (32, 24)));
        assert_eq!(view.truth.background.map(|picture| picture.size()), Some((32, 24)));
        assert_eq!(reduced(&scene.test[0], 1e-9).expect("in memory").image.size(), (16, 16));
    }
}
