//! Fixed cameras that film the same moments.

use std::collections::BTreeMap;

use crate::scene::{Camera, Scene, by_camera};

/// Minimum number of cameras that share a moment. Two cannot distinguish a place from chance.
pub(super) const LEAST_CAMERAS: usize = 3;
/// Minimum number of frames of a camera, and of moments that it shares, as a median needs.
pub(super) const LEAST_FRAMES: usize = 3;

/// The fixed cameras and the moments that they share.
#[derive(Clone, Debug)]
pub(super) struct StillRig {
    pub cameras: Vec<StillCamera>,
    /// In order of time.
    pub moments: Vec<Moment>,
}

/// A fixed camera.
#[derive(Clone, Debug)]
pub(super) struct StillCamera {
    pub camera: Camera,
    /// Its training views.
    pub views: Vec<usize>,
}

/// A moment that several cameras film.
#[derive(Clone, Debug)]
pub(super) struct Moment {
    pub time: f64,
    /// The cameras that film it, with their training views.
    pub shots: Vec<Shot>,
}

/// A camera's view of a moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot {
    /// Index into [`StillRig::cameras`].
    pub camera: usize,
    /// Index of the training view.
    pub view: usize,
}

impl StillRig {
    /// The rig that filmed a scene; `None` if there is no such rig.
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
            // Times are in [0, 1], where bits sort like numbers. Adding 0.0 turns -0.0 into 0.0.
            let shots = by_time.entry((scene.train[view].time + 0.0).to_bits()).or_default();
            // Each camera has one vote.
            if shots.last().is_none_or(|last| last.camera != camera) {
                shots.push(Shot { camera, view });
            }
        }
    }
    let moments = by_time.into_iter().filter(|(_, shots)| shots.len() >= LEAST_CAMERAS);
    moments.map(|(time, shots)| Moment { time: f64::from_bits(time), shots }).collect()
}
