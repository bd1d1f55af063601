//! The step of the centres of a page.

use glam::DVec3;
use mvfusion_data::{GaussianCloud, Scene};
use mvfusion_model::timeline::spread;

/// Gaussians and views that determine the step of the centres.
const STEP_SAMPLES: usize = 2000;
/// Quantile of the pixel sizes, from the smallest, of which the step is a fraction.
const NEAR_QUANTILE: f64 = 0.05;
/// Steps of a centre in a pixel of the training views. Errors are at most half a step.
const STEPS_IN_PIXEL: f64 = 32.0;

/// The step of centres in world units: a fraction of the size that a pixel of the training views has at the nearer
/// Gaussians.
pub(super) fn position_step<'a>(scene: &Scene, near: f64, clouds: impl Iterator<Item = &'a GaussianCloud>) -> f64 {
    let train = &scene.train;
    let mut sizes = Vec::new();
    for cloud in clouds {
        let chosen = spread(cloud.len(), STEP_SAMPLES);
        for (place, &index) in chosen.iter().enumerate() {
            let camera = &train[place * train.len() / chosen.len()].camera;
            let centre = DVec3::from_array(cloud.means[index].map(f64::from));
            let depth = camera.to_camera(centre).z;
            let is_inside = camera.project(centre).is_some_and(|pixel| {
                (0.0..camera.width as f64).contains(&pixel.x) && (0.0..camera.height as f64).contains(&pixel.y)
            });
            if depth > near && is_inside {
                sizes.push(depth / camera.fx.max(camera.fy));
            }
        }
    }
    sizes.sort_by(f64::total_cmp);
    let size = sizes.get((NEAR_QUANTILE * sizes.len() as f64) as usize).copied();
    size.unwrap_or(1e-3 * scene.extent().max(1e-3)) / STEPS_IN_PIXEL
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinKind, BuiltinOptions, Camera, builtin};

    use super::*;

    #[test]
    fn the_step_of_centres_follows_the_sharpest_views_however_few_the_gaussians() {
        let options = BuiltinOptions { width: 48, height: 36, ..BuiltinOptions::of_kind(BuiltinKind::Video) };
        let mut scene = builtin::builtin(&options);
        let camera = scene.train[0].camera;
        // The second half of the views looks closer.
        let half = scene.train.len() / 2;
        for (index, view) in scene.train.iter_mut().enumerate() {
            let factor = if index < half { 1.0 } else { 10.0 };
            view.camera = Camera { fx: factor * camera.fx, fy: factor * camera.fy, ..camera };
        }
        let centre = camera.centre() + 2.0 * camera.forward();
        let cloud = GaussianCloud { means: vec![centre.as_vec3().to_array(); 20], ..GaussianCloud::default() };
        let step = position_step(&scene, 0.1, [&cloud].into_iter());
        let wanted = 2.0 / (10.0 * camera.fx.max(camera.fy)) / STEPS_IN_PIXEL;
        assert!((step / wanted - 1.0).abs() < 1e-3, "{step}, not {wanted}");
    }
}
