//! Points on what moves, where synchronised still cameras see it.

use std::time::Instant;

use glam::{DVec3, Vec3};
use mvfusion_data::motion::{
    MotionFilm, MotionFinder, MotionHullOptions, MovingPixels, MovingPixelsOptions, motion_hull,
};
use mvfusion_data::{PointCloud, Scene};
use mvfusion_render::grid::GridBounds;

use super::Seeding;
use crate::ModelError;
use crate::config::{Branches, Config};
use crate::timeline::Timeline;

/// So large a share of the points may lie outside the box of what moves, on either side of each axis: strays are few but far.
const OUTSIDE: f64 = 0.01;

/// The box of what moves is larger than its points by this share of its sides: a hull has points on surfaces that cameras
/// see, and things turn.
const MARGIN: f64 = 0.1;

/// Points on what moves, each seen at one moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotionPoints {
    /// Where, and in what colour.
    pub points: PointCloud,
    /// When, in the time of the views; one for each point.
    pub times: Vec<f64>,
    /// Time between two frames.
    pub frame: f64,
}

/// What is known of motion before training.
#[derive(Debug, Default)]
pub struct SceneMotion {
    /// Points on what moves, where `init.motion_points` asks for them and finds some.
    pub points: Option<MotionPoints>,
    /// Which pixels move, where the losses ask for that.
    pub moving: Option<MovingPixels>,
    /// What finds places for Gaussians that are born during training, where the configuration asks for some and cameras stand
    /// still. Keeps the pictures that it looks at.
    pub finder: Option<MotionFinder>,
    /// What came of the search for points; `None` where the configuration asks for none.
    pub seeding: Option<Seeding>,
}

impl SceneMotion {
    /// What the configuration asks for. Points are the same for a seed, whatever the number of threads.
    ///
    /// # Errors
    /// If a picture cannot be read.
    pub fn find(scene: &Scene, config: &Config) -> Result<Self, ModelError> {
        let wanted = config.init.motion_points;
        if wanted == 0 || config.model.branches == Branches::Dynamic || config.init.dynamic_ply.is_some() {
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

    /// What training asks for after the first step alone: which pixels move, and places for births, where cameras stand
    /// still.
    ///
    /// # Errors
    /// If a picture cannot be read.
    pub fn of_training(scene: &Scene, config: &Config) -> Result<Self, ModelError> {
        let options = MovingPixelsOptions::default();
        if needs_finder(config) {
            let film = MotionFilm::of(scene, &options)?;
            return Ok(film.map_or_else(Self::default, |film| Self::kept(scene, film, config)));
        }
        let moving = if needs_moving_pixels(config) { MovingPixels::of(scene, &options)? } else { None };
        Ok(Self { moving, ..Self::default() })
    }

    /// What training needs of a film.
    fn kept(scene: &Scene, film: MotionFilm, config: &Config) -> Self {
        if needs_finder(config) {
            let moving = Some(film.moving().clone());
            let finder = Some(MotionFinder::new(scene, film, MotionHullOptions::default()));
            return Self { moving, finder, ..Self::default() };
        }
        Self { moving: needs_moving_pixels(config).then(|| film.into_moving()), ..Self::default() }
    }
}

fn needs_finder(config: &Config) -> bool {
    config.densify.births_interval.0 > 0 && config.model.lifetime && config.model.branches == Branches::Both
}

fn needs_moving_pixels(config: &Config) -> bool {
    let loss = &config.loss;
    let losses_ask =
        loss.mask_motion > 0.0 || loss.mask_still > 0.0 || loss.dynamic_where_moving || loss.static_where_still;
    config.model.branches == Branches::Both && (losses_ask || config.train.lonely_visits > 0.0)
}

impl MotionPoints {
    /// The box of what moves, with its margin; `None` for no points.
    pub(crate) fn bounds(&self) -> Option<GridBounds> {
        let positions = &self.points.positions;
        let last = positions.len().checked_sub(1)?;
        let skipped = (OUTSIDE * last as f64) as usize;
        let along = |axis: usize| {
            let mut sorted: Vec<f32> = positions.iter().map(|position| position[axis]).collect();
            sorted.sort_by(f32::total_cmp);
            [sorted[skipped], sorted[last - skipped]]
        };
        let axes = [along(0), along(1), along(2)];
        let corner = |side: usize| Vec3::from_array(axes.map(|ends| ends[side])).as_dvec3();
        let (min, max) = (corner(0), corner(1));
        let margin = (max - min) * MARGIN + DVec3::splat(f64::from(f32::EPSILON));
        Some(GridBounds { max: (max + margin).to_array(), min: (min - margin).to_array() })
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
