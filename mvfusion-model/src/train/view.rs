//! A training view, without its photo.

use mvfusion_data::Camera;

/// One training view.
#[derive(Clone, Copy, Debug)]
pub struct TrainingView {
    /// The camera.
    pub camera: Camera,
    /// The moment.
    pub time: f64,
    /// Index of the camera among the training cameras ([`training_cameras`](mvfusion_data::Scene::training_cameras)).
    pub number: usize,
}
