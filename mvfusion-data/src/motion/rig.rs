//! Cameras that stand still and film the same moments.

use std::collections::BTreeMap;

use crate::inspect::by_camera;
use crate::{Camera, Scene};

/// Cameras that must film a moment together: two cannot tell a place from a chance.
pub(super) const LEAST_CAMERAS: usize = 3;
/// Frames that a camera must have, and moments that the cameras must share: a median needs as many.
pub(super) const LEAST_FRAMES: usize = 3;

/// The cameras that stand still and what they film together.
#[derive(Clone, Debug)]
pub(super) struct StillRig {
    pub cameras: Vec<StillCamera>,
    /// In order of time.
    pub moments: Vec<Moment>,
}

/// A camera that stands still.
#[derive(Clone, Debug)]
pub(super) struct StillCamera {
    pub camera: Camera,
    /// Its training views.
    pub views: Vec<usize>,
}

/// What several cameras see at one time.
#[derive(Clone, Debug)]
pub(super) struct Moment {
    pub time: f64,
    /// The cameras that film it, and their training views.
    pub shots: Vec<Shot>,
}

/// A camera's view of a moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot {
    /// Number in [`StillRig::cameras`].
    pub camera: usize,
    /// Number of the training view.
    pub view: usize,
}

impl StillRig {
    /// The rig that filmed a scene, or `None` if it was filmed otherwise.
    pub fn of(scene: &Scene) -> Option<Self> {
        let groups = by_camera(scene.train.iter()).into_iter().filter(|views| views.len() >= LEAST_FRAMES);
        let cameras: Vec<StillCamera> =
            groups.map(|views| StillCamera { camera: scene.train[views[0]].camera, views }).collect();
        let moments = moments(scene, &cameras);
        let in_step = |camera: usize| {
            let shared = moments.iter().filter(|m| m.shots.iter().any(|shot| shot.camera == camera)).count();
            shared >= LEAST_FRAMES
        };
        let synchronised = (0..cameras.len()).filter(|&camera| in_step(camera)).count();
        (synchronised >= LEAST_CAMERAS).then_some(Self { cameras, moments })
    }
}

/// The times at which enough cameras film.
fn moments(scene: &Scene, cameras: &[StillCamera]) -> Vec<Moment> {
    let mut by_time: BTreeMap<u64, Vec<Shot>> = BTreeMap::new();
    for (camera, still) in cameras.iter().enumerate() {
        for &view in &still.views {
            // Times lie in [0, 1], where the order of the bits is that of the numbers; -0.0 is 0.0.
            let shots = by_time.entry((scene.train[view].time + 0.0).to_bits()).or_default();
            // A camera has one vote.
            if shots.last().is_none_or(|last| last.camera != camera) {
                shots.push(Shot { camera, view });
            }
        }
    }
    let moments = by_time.into_iter().filter(|(_, shots)| shots.len() >= LEAST_CAMERAS);
    moments.map(|(time, shots)| Moment { time: f64::from_bits(time), shots }).collect()
}
