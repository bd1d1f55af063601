//! A training view, without its photo.

use mvfusion_data::Camera;

/// One training view.
#[derive(Clone, Copy, Debug)]
pub struct TrainingView {
    /// The camera.
    pub camera: Camera,
    /// The moment.
    pub time: f64,
    /// Number of the camera among those that train ([`training_cameras`](mvfusion_data::Scene::training_cameras)).
    pub number: usize,
}
