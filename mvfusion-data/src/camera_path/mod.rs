//! Camera paths for rendering: generated around a scene, or read from files.

mod camera;
mod file;
mod orbit;
mod placed;
mod spiral;
mod vantage;

pub use camera::{CameraError, LONGEST_SIDE, check_camera};
pub use file::{CameraPath, FRAME_RATES, MOST_ENTRIES, PathEntry, read_camera_path};
pub use orbit::orbit;
pub use spiral::spiral;
pub use vantage::Vantage;

use crate::scene::{Scene, View};

/// `count` moments, evenly spaced from the first to the last time of the training views.
pub fn running_times(scene: &Scene, count: usize) -> Vec<f64> {
    let times = scene.training_times();
    let (first, last) = (times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(0.0));
    let steps = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|i| first + (last - first) * (i as f64 / steps)).collect()
}

/// The view whose camera a user means. `wanted` is the name of a view (`cam00/0003`), the name of a camera (`cam00`,
/// meaning its first view), or an index into the held-out views. If no view is held out, the index counts training
/// views. Names of held-out views take precedence over those of training views.
pub fn find_view<'a>(scene: &'a Scene, wanted: &str) -> Option<&'a View> {
    let all = || scene.test.iter().chain(&scene.train);
    let named = |view: &&View| view.name == wanted;
    let of_camera = |view: &&View| view.name.rsplit_once('/').is_some_and(|(camera, _)| camera == wanted);
    let numbered = || {
        let index: usize = wanted.parse().ok()?;
        if scene.test.is_empty() { scene.train.get(index) } else { scene.test.get(index) }
    };
    all().find(named).or_else(|| all().find(of_camera)).or_else(numbered)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;
    use crate::builtin::{BuiltinKind, BuiltinOptions};

    fn scene() -> Scene {
        builtin::builtin(&BuiltinOptions { width: 32, height: 24, ..BuiltinOptions::of_kind(BuiltinKind::Video) })
    }

    #[test]
    fn times_run_once_from_the_first_to_the_last() {
        let scene = scene();
        let times = running_times(&scene, 5);
        let training = scene.training_times();
        assert_eq!((times.len(), times[0], times[4]), (5, training[0], training[training.len() - 1]));
        assert!(times.is_sorted());
        assert_eq!(running_times(&scene, 1), [training[0]]);
    }

    #[test]
    fn a_view_is_found_by_its_name_by_its_camera_and_by_its_number() {
        let scene = scene();
        let (test, train) = (&scene.test[3], scene.train.last().expect("views"));
        let found = |wanted: &str| find_view(&scene, wanted).map(|view| view.name.as_str());
        assert_eq!(found(&test.name), Some(&*test.name));
        assert_eq!(found("3"), Some(&*test.name));
        let camera = train.name.rsplit_once('/').expect("camera/frame").0;
        let place = find_view(&scene, camera).expect("found").camera;
        assert_eq!(place, train.camera);
        assert_eq!(found("cam99"), None);
        assert_eq!(found("100000"), None);
    }
}
