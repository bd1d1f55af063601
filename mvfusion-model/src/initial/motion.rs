//! Points on moving objects, detected by fixed, synchronised cameras.

use std::time::Instant;

use glam::{DVec3, Vec3};
use mvfusion_data::motion::{
    MotionFilm, MotionFinder, MotionHullOptions, MovingPixels, MovingPixelsOptions, motion_hull,
};
use mvfusion_data::{PointCloud, Scene};
use mvfusion_render::grid::GridBounds;

use super::Seeding;
use super::points::range_without_strays;
use crate::ModelError;
use crate::config::{Branches, Config};
use crate::timeline::Timeline;

/// Margin of the motion box, as a fraction of its sides. The hull has points only on visible surfaces, and objects
/// rotate.
const MARGIN: f64 = 0.1;

/// Points on moving objects, each with its moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionPoints {
    /// Positions and colours.
    pub points: PointCloud,
    /// Moment of each point, in the time of the views.
    pub times: Vec<f64>,
    /// Time between two frames.
    pub frame: f64,
}

/// The motion that is detected before training.
#[derive(Debug, Default)]
pub struct SceneMotion {
    /// Points on moving objects, if `init.motion_points` is set and some were found.
    pub points: Option<MotionPoints>,
    /// The moving pixels, if the losses need them.
    pub moving: Option<MovingPixels>,
    /// Finds positions for Gaussians that are born during training, if configured and with fixed cameras. Keeps its
    /// images.
    pub finder: Option<MotionFinder>,
    /// The result of the search for points; `None` if it is not configured.
    pub seeding: Option<Seeding>,
}

impl SceneMotion {
    /// Detects the motion that the configuration needs. The points depend on the seed, not on the number of threads.
    ///
    /// # Errors
    /// If an image cannot be read.
    pub fn find(scene: &Scene, config: &Config) -> Result<Self, ModelError> {
        let wanted = config.init.motion_points;
        if !needs_points(config) {
            return Self::of_training(scene, config);
        }
        let start = Instant::now();
        let Some(film) = MotionFilm::of(scene, &MovingPixelsOptions::default())? else {
            return Ok(Self { seeding: Some(Seeding::NoStillCameras), ..Self::default() });
        };
        let options = MotionHullOptions { points: wanted, ..MotionHullOptions::default() };
        let seeds = motion_hull(scene, &film, &options, config.seed);
        let (seconds, bytes) = (start.elapsed().as_secs_f64(), film.bytes());
        let seeding = Some(Seeding::Searched { summary: seeds.summary, seconds, bytes });
        let frame = Timeline::new(scene.training_times()).spacing();
        let points =
            (!seeds.points.is_empty()).then_some(MotionPoints { points: seeds.points, times: seeds.times, frame });
        Ok(Self { points, seeding, ..Self::kept(scene, film, config) })
    }

    /// Detects only what training needs after the first step: moving pixels, and positions for births.
    ///
    /// # Errors
    /// If an image cannot be read.
    pub fn of_training(scene: &Scene, config: &Config) -> Result<Self, ModelError> {
        let options = MovingPixelsOptions::default();
        if Self::finds_births(config) {
            let film = MotionFilm::of(scene, &options)?;
            return Ok(film.map_or_else(Self::default, |film| Self::kept(scene, film, config)));
        }
        let moving = if needs_moving_pixels(config) { MovingPixels::of(scene, &options)? } else { None };
        Ok(Self { moving, ..Self::default() })
    }

    /// Whether the configuration needs the images of fixed cameras before the first step.
    pub(crate) fn reads_film(config: &Config) -> bool {
        needs_points(config) || Self::finds_births(config) || needs_moving_pixels(config)
    }

    /// Whether Gaussians are born for objects that come into the film of fixed cameras.
    pub(crate) fn finds_births(config: &Config) -> bool {
        config.densify.births_interval.0 > 0 && config.model.lifetime && config.model.branches == Branches::Both
    }

    /// The parts of a film that training needs.
    fn kept(scene: &Scene, film: MotionFilm, config: &Config) -> Self {
        if Self::finds_births(config) {
            let moving = Some(film.moving().clone());
            let finder = Some(MotionFinder::new(scene, film, MotionHullOptions::default()));
            return Self { moving, finder, ..Self::default() };
        }
        Self { moving: needs_moving_pixels(config).then(|| film.into_moving()), ..Self::default() }
    }
}

fn needs_points(config: &Config) -> bool {
    config.init.motion_points > 0 && config.model.branches == Branches::Both && config.init.dynamic_ply.is_none()
}

fn needs_moving_pixels(config: &Config) -> bool {
    let loss = &config.loss;
    let losses_ask =
        loss.mask_motion > 0.0 || loss.mask_still > 0.0 || loss.dynamic_where_moving || loss.static_where_still;
    (config.model.branches == Branches::Both && losses_ask) || config.train.lonely_visits > 0.0
}

impl MotionPoints {
    /// The box of what moves, without strays and with its margin; `None` without points.
    pub(crate) fn bounds(&self) -> Option<GridBounds> {
        let along = |axis| range_without_strays(&self.points.positions, axis);
        let axes = [along(0)?, along(1)?, along(2)?];
        let corner = |side: usize| Vec3::from_array(axes.map(|ends| ends[side])).as_dvec3();
        let (min, max) = (corner(0), corner(1));
        let margin = (max - min) * MARGIN + DVec3::splat(f64::from(f32::EPSILON));
        Some(GridBounds { min: (min - margin).to_array(), max: (max + margin).to_array() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_of_what_moves_leaves_strays_out() {
        let mut points = PointCloud::default();
        (0..200).for_each(|i| points.push(Vec3::splat(i as f32 / 199.0), Vec3::ONE));
        points.push(Vec3::splat(1000.0), Vec3::ONE);
        let motion = MotionPoints { times: vec![0.0; points.len()], points, frame: 1.0 };
        let bounds = motion.bounds().expect("there are points");
        assert!(bounds.max.iter().all(|&side| (1.0..1.2).contains(&side)), "{bounds:?}");
        assert!(bounds.min.iter().all(|&side| (-0.2..0.0).contains(&side)), "{bounds:?}");
        assert_eq!(MotionPoints::default().bounds(), None);
    }
}
