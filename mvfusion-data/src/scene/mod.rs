//! A scene: the output of every reader and the input of everything downstream.
//!
//! A [`Scene`] has training and held-out [`View`]s, each with a [`Camera`], a time and a [`Picture`], and an initial
//! [`PointCloud`].

mod activation;
mod cache;
mod camera;
mod check;
mod gaussian_arrays;
mod gaussian_cloud;
mod lens;
mod limits;
mod mask;
mod picture;
mod points;
mod rig;
mod undistort;
mod view;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use activation::{logit, sigmoid, unit_quaternion};
pub use cache::{Decoded, PictureCache};
pub use camera::Camera;
pub(crate) use camera::nearest_to_axes;
pub use gaussian_arrays::NamedArray;
pub use gaussian_cloud::{GaussianCloud, LIFETIME_FIELDS, Lifetime, MASK_FIELDS, rest_width};
pub use lens::{Distortion, Lens};
pub use limits::LARGEST_COORDINATE;
pub(crate) use limits::{LARGEST_COEFFICIENT, LOG_SIZES, check_place};
pub use mask::Mask;
pub use picture::{ExifOrientation, Picture, PictureFile, PictureSource};
pub(crate) use picture::{PictureHeader, PictureUse, check_shape};
pub use points::PointCloud;
pub use rig::{by_camera, distinct_cameras};
pub(crate) use undistort::pinhole_within;
pub use view::{Truth, View};

/// The kind of capture, on which depend the initialisation of the Gaussians (METHOD §3) and what held-out views are
/// compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Capture {
    /// Moments of one scene, filmed by synchronised cameras as in Neu3D, or by one moving camera.
    Video,
    /// One photo per moment, with distractors, as in NeRF On-the-go and RobustNeRF.
    Photos,
}

/// A captured scene, ready to train on. One that your own program built is checked by [`Scene::check`].
#[derive(Clone, Debug)]
pub struct Scene {
    /// Name for messages: the folder's, or `built-in video`.
    pub name: String,
    /// The kind of capture.
    pub capture: Capture,
    /// Training views. Never empty.
    pub train: Vec<View>,
    /// Held-out views.
    pub test: Vec<View>,
    /// Points from structure from motion; may be empty.
    pub points: PointCloud,
    /// Lower bound of the depth of any surface in a training camera, along its axis and in world units, if the capture
    /// states it.
    pub near: Option<f64>,
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
    /// 1.1 times the largest distance of a training camera's centre from their mean (METHOD §3). Learning rates and
    /// thresholds are in units of it.
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

    /// The camera index of every training view. Views with the same pose and lens share an index; cameras are numbered
    /// in order of first appearance.
    pub fn training_cameras(&self) -> Vec<usize> {
        let mut cameras = vec![0; self.train.len()];
        for (camera, views) in by_camera(self.train.iter()).into_iter().enumerate() {
            views.into_iter().for_each(|view| cameras[view] = camera);
        }
        cameras
    }

    /// The distinct times of the training views, sorted.
    pub fn training_times(&self) -> Vec<f64> {
        let mut times: Vec<f64> = self.train.iter().map(|v| v.time).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        times
    }
}
