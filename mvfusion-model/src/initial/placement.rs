//! Whether the dynamic Gaussians stand where something moves, found out before a run is spent on them.

use std::fmt::{self, Display};

use mvfusion_data::motion::{MovingPixels, MovingPixelsOptions};
use mvfusion_data::{Camera, PointCloud, Scene};
use rayon::prelude::*;

use crate::ModelError;
use crate::model::gaussians::Gaussians;
use crate::timeline::spread;

/// So many cameras are looked at, at so many moments; each spread over those that there are. A long recording is not read
/// for this, and a median needs a dozen moments.
const CAMERAS: usize = 4;
const MOMENTS: usize = 12;

/// Where the dynamic Gaussians stand in pictures of cameras that stand still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Gaussians whose centre falls on a pixel that counts, summed over the pictures; with lifetimes, of those that are
    /// there at the picture's moment.
    pub seen: usize,
    /// Those of them that fall on a pixel that moves.
    pub on_motion: usize,
    /// Pictures that were looked at.
    pub pictures: usize,
    /// Mean share of a picture's pixels that move; above 0.
    pub moving_share: f64,
}

impl Placement {
    /// Below this share the program warns. Measured before the first step on the built-in video, whose pixels move by
    /// 4.4 %: 4000 Gaussians strewn over the room, which end as a smear (15 dB), have 7.0 %; seeds of the motion hull
    /// have 38 %, with lifetimes 60 %. On 15 cameras of the CMU Panoptic studio known points alone have 28 %.
    pub const LEAST: f64 = 0.15;

    /// Where `dynamic` stands in the training views of `scene`; the network is not asked. `None` where no three still
    /// cameras film the same moments, and where nothing moves in their pictures. At most 48 pictures are read.
    ///
    /// # Errors
    /// If a picture cannot be read, or the device cannot hand its numbers back.
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

    /// Share of the Gaussians in the pictures that fall on a pixel that moves; 0 where there are none.
    pub fn share(&self) -> f64 {
        self.on_motion as f64 / self.seen.max(1) as f64
    }

    /// What to do about a share below [`Placement::LEAST`]; `None` if there is nothing to be done.
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

/// A scene of a few views: some of the cameras that film the first moment, at some moments.
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

    /// Where the Gaussians stand that a configuration starts from.
    fn placement(scene: &Scene, config: &Config, device: &Device) -> Option<Placement> {
        let motion = SceneMotion::find(scene, config).expect("in memory");
        let stream = &mut Streams::new(config.seed).clouds;
        let clouds = InitialClouds::draw(scene, motion.points.as_ref(), config, stream).expect("in memory");
        let masking = Masking::Blended { dynamic_logit: 0.0 };
        let dynamic = gaussians_of(&clouds.dynamic, masking, 0, &device.clone().autodiff(), DType::F32);
        Placement::of(&dynamic, scene).expect("in memory")
    }

    #[test]
    fn strewn_gaussians_are_warned_of_and_those_on_the_motion_hull_are_not() {
        let scene =
            builtin::builtin(&BuiltinOptions { width: 80, height: 60, frames: 12, ..BuiltinOptions::default() });
        for_each_device(|device| {
            let mut config = Config::default();
            config.init.dynamic_points = 4000;
            let strewn = placement(&scene, &config, &device).expect("cameras stand still");
            assert_eq!(strewn.pictures, CAMERAS * MOMENTS);
            let advice = strewn.advice().expect("they are all over the room");
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
