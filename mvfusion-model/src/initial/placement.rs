//! A check before training of whether the dynamic Gaussians start where something moves.

use std::fmt::{self, Display};

use mvfusion_data::motion::{MovingPixels, MovingPixelsOptions};
use mvfusion_data::{Camera, PointCloud, Scene};
use rayon::prelude::*;

use crate::ModelError;
use crate::model::gaussians::Gaussians;
use crate::timeline::spread;

/// Number of evenly spaced cameras and moments that are checked. A long recording need not be read completely, but a
/// median needs a dozen moments.
const CAMERAS: usize = 4;
const MOMENTS: usize = 12;

/// The placement of the dynamic Gaussians in images of fixed cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Gaussians whose centre projects to a valid pixel, summed over the images. With lifetimes, only those present at
    /// the image's moment.
    pub seen: usize,
    /// Those of them on a moving pixel.
    pub on_motion: usize,
    /// Number of images.
    pub pictures: usize,
    /// Mean fraction of moving pixels in an image; above 0.
    pub moving_share: f64,
}

impl Placement {
    /// The program warns below this fraction. In the built-in video, 4.4 % of the pixels move. 4000 uniform Gaussians
    /// have 7.0 % before the first step and end as a smear (15 dB). Seeds of the motion hull have 38 %, and 60 % with
    /// lifetimes. On 15 cameras of the CMU Panoptic studio, known points alone have 28 %.
    pub const LEAST: f64 = 0.15;

    /// The placement of `dynamic` in the training views of `scene`, without deformation. `None` without three fixed
    /// cameras that film the same moments, or if nothing moves in their images. Reads at most 48 images.
    ///
    /// # Errors
    /// If an image cannot be read, or the device fails to return values.
    pub fn of(dynamic: &Gaussians, scene: &Scene) -> Result<Option<Self>, ModelError> {
        let sample = sample(scene);
        let Some(moving) = MovingPixels::of(&sample, &MovingPixelsOptions::default())? else { return Ok(None) };
        let moving_share = moving.mean_share();
        if moving_share == 0.0 {
            return Ok(None);
        }
        let mut found = Self { seen: 0, on_motion: 0, pictures: sample.train.len(), moving_share };
        for time in sample.training_times() {
            let centres = dynamic.centres_at(time)?;
            for (index, view) in sample.train.iter().enumerate().filter(|(_, view)| view.time == time) {
                let pixel = |centre: &glam::Vec3| {
                    let position = view.camera.project(centre.as_dvec3())?;
                    moving.map(index)?.at(position).filter(|pixel| pixel.counts())
                };
                let counts =
                    |[seen, on_motion]: [usize; 2], [more, moving]: [usize; 2]| [seen + more, on_motion + moving];
                let of_centre = centres.par_iter().filter_map(pixel).map(|pixel| [1, usize::from(pixel.moves())]);
                let [seen, on_motion] = of_centre.reduce(|| [0; 2], counts);
                (found.seen, found.on_motion) = (found.seen + seen, found.on_motion + on_motion);
            }
        }
        Ok(Some(found))
    }

    /// Fraction of the visible Gaussians that are on a moving pixel; 0 if none are visible.
    pub fn share(&self) -> f64 {
        self.on_motion as f64 / self.seen.max(1) as f64
    }

    /// The remedy for a fraction below [`Placement::LEAST`]; `None` if it is not.
    pub fn advice(&self) -> Option<String> {
        (self.share() < Self::LEAST).then(|| {
            format!(
                "below {:.0} % what moves is likely to stay a smear. Set `init.motion_points` (a quarter to a half of \
                 `densify.dynamic.max_gaussians`) and `model.grid.bounds = \"motion\"`, or start from Gaussians on what \
                 moves with `init.dynamic_ply`",
                100.0 * Self::LEAST,
            )
        })
    }
}

impl Display for Placement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pictures, moving_share, .. } = self;
        write!(f, "{:.1} % of the dynamic Gaussians start on pixels that move ", 100.0 * self.share())?;
        write!(f, "({pictures} pictures, of whose pixels {:.1} % move)", 100.0 * moving_share)
    }
}

/// A scene with a few views: some of the cameras of the first moment, at some moments.
fn sample(scene: &Scene) -> Scene {
    let times = scene.training_times();
    let moments: Vec<f64> = spread(times.len(), MOMENTS).into_iter().map(|index| times[index]).collect();
    let first: Vec<&Camera> =
        scene.train.iter().filter(|view| moments.first() == Some(&view.time)).map(|view| &view.camera).collect();
    let cameras: Vec<&Camera> = spread(first.len(), CAMERAS).into_iter().map(|index| first[index]).collect();
    let is_chosen = |view: &&mvfusion_data::View| moments.contains(&view.time) && cameras.contains(&&view.camera);
    Scene {
        name: scene.name.clone(),
        capture: scene.capture,
        train: scene.train.iter().filter(is_chosen).cloned().collect(),
        test: Vec::new(),
        points: PointCloud::default(),
        near: None,
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device};
    use mvfusion_data::{BuiltinOptions, builtin};

    use super::*;
    use crate::Config;
    use crate::initial::{InitialClouds, Masking, SceneMotion, gaussians_of};
    use crate::random::Streams;
    use crate::test_support::for_each_device;

    /// The placement of the initial Gaussians of a configuration.
    fn placement(scene: &Scene, config: &Config, device: &Device) -> Option<Placement> {
        let motion = SceneMotion::find(scene, config).expect("in memory");
        let stream = &mut Streams::new(config.seed).clouds;
        let clouds = InitialClouds::draw(scene, motion.points.as_ref(), config, stream).expect("in memory");
        let masking = Masking::Blended { dynamic_logit: 0.0 };
        let dynamic = gaussians_of(&clouds.dynamic, masking, 0, &device.clone().autodiff(), DType::F32);
        Placement::of(&dynamic, scene).expect("in memory")
    }

    #[test]
    fn uniform_gaussians_are_warned_of_and_those_on_the_motion_hull_are_not() {
        let scene =
            builtin::builtin(&BuiltinOptions { width: 80, height: 60, frames: 12, ..BuiltinOptions::default() });
        for_each_device(|device| {
            let mut config = Config::default();
            config.init.dynamic_points = 4000;
            let uniform = placement(&scene, &config, &device).expect("cameras stand still");
            assert_eq!(uniform.pictures, CAMERAS * MOMENTS);
            let advice = uniform.advice().expect("they are all over the room");
            assert!(advice.contains("init.motion_points"), "{advice}");

            config.init.motion_points = 1000;
            for lifetime in [false, true] {
                config.model.lifetime = lifetime;
                let seeded = placement(&scene, &config, &device).expect("cameras stand still");
                assert_eq!(seeded.advice(), None, "{seeded}");
            }
        });
    }

    #[test]
    fn where_nothing_moves_there_is_nothing_to_say() {
        let options = BuiltinOptions { width: 32, height: 24, frames: 3, ..BuiltinOptions::default() };
        let mut scene = builtin::builtin(&options);
        for_each_device(|device| assert!(placement(&scene, &Config::default(), &device).is_some()));
        for view in &mut scene.train {
            view.image = view.truth.background.clone().expect("built in");
        }
        for_each_device(|device| assert_eq!(placement(&scene, &Config::default(), &device), None));
    }
}
