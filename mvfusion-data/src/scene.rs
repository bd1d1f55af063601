//! What every reader delivers: views, split into training and test, and points to start from.

use std::sync::Arc;

use glam::DVec3;

use crate::inspect::by_camera;
use crate::{Camera, Mask, Picture, PointCloud};

/// How a scene was captured, which decides how its Gaussians are initialised (METHOD §3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Capture {
    /// Synchronised cameras filming the same moments: Neu3D and its kin.
    Video,
    /// One photo a moment, with passers-by: NeRF On-the-go, RobustNeRF.
    Photos,
}

/// A captured scene, ready to train on.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name for people: the folder's, or `built-in video`.
    pub name: String,
    /// How it was captured.
    pub capture: Capture,
    /// Views to learn from. Never empty.
    pub train: Vec<View>,
    /// Views held out.
    pub test: Vec<View>,
    /// Points from structure from motion; may be empty.
    pub points: PointCloud,
    /// No surface is nearer to a training camera than this, along its axis and in world units, as the capture says.
    pub near: Option<f64>,
}

/// One picture: what a camera saw at a time.
#[derive(Clone, Debug)]
pub struct View {
    /// Unique among the views that train, and among those held out: `cam00/0003`.
    pub name: String,
    /// The camera, for the size of [`View::image`].
    pub camera: Camera,
    /// Moment in `[0, 1]`.
    pub time: f64,
    /// The photo.
    pub image: Picture,
    /// Which of its pixels count; all, where there is none.
    pub mask: Option<Mask>,
    /// What is known beyond the photo; evaluation only, never training.
    pub truth: Truth,
}

/// What is known of a view beyond its photo. An unknown item is absent.
#[derive(Clone, Debug, Default)]
pub struct Truth {
    /// The photo as it would be without anything that moves.
    pub background: Option<Picture>,
    /// White where something moves.
    pub dynamic_mask: Option<Picture>,
    /// Whether [`Truth::dynamic_mask`] is exact, as that of a built-in scene, and not what somebody takes for moving.
    pub is_mask_exact: bool,
    /// White where a mover is in front: something that goes somewhere, not what sways in its place. Known of built-in
    /// scenes alone, and only where [`Truth::dynamic_mask`] is.
    pub movers_mask: Option<Picture>,
    /// Depth along the camera's z axis in world units at the pixel centres, row by row; for the built-in scenes.
    pub depth: Option<Arc<Vec<f32>>>,
}

/// An axis-aligned box in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Corner with the smallest coordinates.
    pub min: DVec3,
    /// Corner with the largest coordinates.
    pub max: DVec3,
}

impl Scene {
    /// 1.1 times the largest distance of a training camera's centre from their mean (METHOD §3): the unit in which
    /// learning rates and thresholds are given.
    pub fn extent(&self) -> f64 {
        let mean = self.training_centre();
        let reach = self.train.iter().map(|v| v.camera.centre().distance(mean)).fold(0.0, f64::max);
        1.1 * reach
    }

    /// Mean of the training cameras' centres.
    pub fn training_centre(&self) -> DVec3 {
        self.train.iter().map(|v| v.camera.centre()).sum::<DVec3>() / self.train.len().max(1) as f64
    }

    /// Smallest box around the training cameras' centres.
    pub fn camera_bounds(&self) -> Bounds {
        let start = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };
        self.train.iter().map(|v| v.camera.centre()).fold(start, |b, c| Bounds { min: b.min.min(c), max: b.max.max(c) })
    }

    /// The camera of every training view, by number: views of one pose and one lens share it. Numbered as they first
    /// appear.
    pub fn training_cameras(&self) -> Vec<usize> {
        let mut cameras = vec![0; self.train.len()];
        for (camera, views) in by_camera(self.train.iter()).into_iter().enumerate() {
            views.into_iter().for_each(|view| cameras[view] = camera);
        }
        cameras
    }

    /// The times of the training views, sorted, each once.
    pub fn training_times(&self) -> Vec<f64> {
        let mut times: Vec<f64> = self.train.iter().map(|v| v.time).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }
}
